"""The decision: from scores, chances and shares to a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plop.diagnosis.decision.amplitude import curve_of, refine, settled
from plop.diagnosis.decision.finding import Finding, finding_of, worse
from plop.diagnosis.decision.limits import Limit, detection_limits, unseen
from plop.diagnosis.decision.verdict import Grounds, Verdict, VerdictKind
from plop.diagnosis.decision.verdict_text import verdict_text
from plop.diagnosis.rule import RULE, DecisionRule
from plop.diagnosis.scores.score import Score, one_per_law, one_per_setting
from plop.diagnosis.scores.search import Search

_TURNS = 4
"""Rounds in which two laws are fitted to what the other leaves."""


@dataclass(frozen=True)
class Conclusion:
    """All that was found, with the arrays behind it; a `Diagnosis` is what is kept of it."""

    verdict: Verdict
    findings: list[Finding]
    """One for each law, best first; what is named comes first."""
    limits: dict[str, Limit]
    """Law -> smallest amplitude that would have been named."""
    search: Search
    rivals: list[Score]
    """What the best law cannot be distinguished from: other laws, else other settings of the same law."""
    dropped: dict[str, str]
    """Episodes and laws left out, with the reason."""
    gains: dict[str, np.ndarray]
    """Law -> gain of each episode [nats], by which laws are compared: with weights found without any law."""


def conclude(search: Search, sensors: Sequence[str] = (), rule: DecisionRule = RULE, whole: bool = True) -> Conclusion:
    """Judge by what has been computed.

    Args:
        search: It.
        sensors: Significant sensor faults, in words.
        rule: Error rates and margins.
        whole: The whole library was tried.
    """
    scores = search.scores()
    findings = _findings(scores, rule)
    facts = _grounds(search, sensors)
    missing = facts.change_p is not None and facts.change_p <= rule.alarm
    first = _strongest(findings, rule)
    if first is None and missing:
        first, scores = _likely(search, scores, facts, rule)
    rivals = [] if first is None else _rivals(first, scores, rule)
    decoys = (first.name,) if first is not None and first.kind == "decoy" else ()
    chosen, verdict = list[Finding](), None
    if first is not None and not decoys:
        own, first = _settled(search, first, scores, rule)
        if first.stands:
            chosen, verdict = _named(own, first, findings, rivals, facts, rule)
        else:
            first = None
    if verdict is None:
        # a law that is certain, but explains too little to be named, is a sign of something else
        like = None if first is None or missing or decoys else first.name
        verdict = _nameless(search, missing or first is not None, replace(facts, decoys=decoys, resembles=like), rule)
    if sensors:
        facts = replace(verdict.evidence, physics=verdict.kind, physics_named=verdict.named)
        verdict = Verdict(VerdictKind.SENSOR, tuple(sensors), "", facts)
    ranked = [*chosen, *(f for f in findings if f.name not in {c.name for c in chosen})]
    failed = search.failed()
    tried = [c.effect for c in search.candidates if c.effect not in failed]
    named = None if whole and not failed else list(dict.fromkeys(tried))
    verdict = replace(verdict, text=verdict_text(verdict, ranked, named))
    limits = detection_limits(search, one_per_law(scores), rule)
    limits |= {c.effect: unseen(c.columns[0]) for c in search.candidates if c.effect not in limits}
    gains = {s.hypothesis.effect: s.gains for s in one_per_law(scores)}
    return Conclusion(verdict, ranked, limits, search, rivals, _dropped(search, scores), gains)


def _nameless(search: Search, missing: bool, facts: Grounds, rule: DecisionRule) -> Verdict:
    """Say whether something is missing, and where the recordings differ from the reference if they may."""
    kind = VerdictKind.NONE_OF_THESE if missing else VerdictKind.NOTHING_DETECTABLE
    # either of two ways may show it: the chance is twice the smaller one
    likely = facts.change_p is not None and facts.change_p <= 2 * rule.alike
    perhaps = likely or (missing and facts.reference and not facts.decoys)
    shown = search.difference.described() if perhaps else None
    alone = () if missing or not facts.reference else tuple(search.difference.alone(rule.alarm))
    return Verdict(kind, (), "", replace(facts, description=shown, alone=alone))


def _strongest(findings: Sequence[Finding], rule: DecisionRule) -> Finding | None:
    """Find the law that is there: where chance finds none as strong as some law, the one that explains most.

    A chance says whether something is there, not what: of two laws that resemble each other, the one that explains less
    may be the less likely by chance.
    """
    first = next((f for f in findings if f.stands), None)
    if first is None or first.kind == "decoy":
        return first
    least = min(f.score.p for f in findings if f.stands)
    likely = (f for f in findings if f.score.p <= rule.alike and f.kind != "decoy")
    certain = (finding_of(replace(f.score, p=least), [], rule) for f in likely)
    return next((f for f in certain if f.stands), first)


def _likely(
    search: Search, scores: list[Score], facts: Grounds, rule: DecisionRule
) -> tuple[Finding | None, list[Score]]:
    """Find the law of a difference that is certain, though none of the laws is by itself.

    That something is there is known, with the chance of the difference. The strongest law is what it is if it is
    unlikely to be as strong by chance, or if it takes most of the difference away and nothing is left that stands out.
    """
    given = [replace(s, p=min(s.p, facts.change_p or 1.0)) for s in scores]
    first = next((f for f in _findings(given, rule) if f.stands and f.kind != "decoy"), None)
    if first is None:
        return None, scores
    own = next(s.p for s in scores if s.hypothesis == first.score.hypothesis)
    if own > rule.alike and not _explains(search, first.score, given, rule):
        return None, scores
    alike = [s for s in _rivals(first, given, rule) if s.hypothesis.effect != first.name]
    others = {s.hypothesis.effect for s in alike if _explains(search, s, given, rule)}
    kept = {first.name, *others}
    return first, [s if s.hypothesis.effect in kept else old for s, old in zip(given, scores, strict=True)]


def _explains(search: Search, score: Score, scores: Sequence[Score], rule: DecisionRule) -> bool:
    """Tell whether a law takes most of the difference away, and nothing is left that stands out."""
    settled, found = _settled(search, finding_of(score, [], rule), scores, rule)
    rest = settled.beside(found.score)
    closed = closed_by(settled, rest)
    return closed is not None and closed >= rule.most and not stands_out(rest, rule)


def _findings(scores: list[Score], rule: DecisionRule) -> list[Finding]:
    """Judge every law by its best setting."""
    return [finding_of(best, _settings(best, scores, rule), rule) for best in one_per_law(scores)]


def _settings(best: Score, scores: Sequence[Score], rule: DecisionRule) -> list[Score]:
    """Find the other settings of a law that do as well, but for chance between episodes."""
    own = best.hypothesis
    same = [s for s in one_per_setting(scores) if s.hypothesis.effect == own.effect]
    return [s for s in same if s.hypothesis.candidate.key != own.candidate.key and not worse(best, s, rule)]


def _settled(search: Search, first: Finding, scores: Sequence[Score], rule: DecisionRule) -> tuple[Search, Finding]:
    """Give the first law with the amplitude, and the weights of patches, that belong to each other."""
    found, score = settled(search, first.score)
    others = [settled(search, s)[1] for s in _settings(first.score, scores, rule)]
    return found, finding_of(score, others, rule, curve_of(search, score, rule.response_width))


def _grounds(search: Search, sensors: Sequence[str]) -> Grounds:
    sizes, here = search.sizes(), search.here
    floor = None if here.all() else float(sizes[~here].mean())
    return Grounds(
        tuple(sensors), float(sizes[here].mean()), floor, change_p=search.difference.p, reference=not here.all()
    )


def _rivals(first: Finding, scores: Sequence[Score], rule: DecisionRule) -> list[Score]:
    """Find the laws that do as well as the best one, but for chance between episodes; if none, its other settings."""
    laws = [s for s in one_per_law(scores) if s.hypothesis.effect != first.name]
    alike = [
        s
        for s in laws
        if s.p <= rule.alike and s.hypothesis.candidate.kind != "decoy" and not worse(first.score, s, rule)
    ]
    return alike or _settings(first.score, scores, rule)


def _named(
    search: Search, first: Finding, findings: list[Finding], rivals: list[Score], facts: Grounds, rule: DecisionRule
) -> tuple[list[Finding], Verdict | None]:
    """Name the best law: alone, with a second one, as a part, or with those that cannot be distinguished from it.

    Returns:
        What is named with its amplitudes, and the verdict; None where naming it would explain too little.
    """
    others = [s.hypothesis.effect for s in rivals if s.hypothesis.effect != first.name]
    rest = search.beside(first.score)
    chosen, gain = [first], first.gain
    without, removed = first.score.explained
    closed, left = closed_by(search, rest), without - removed
    second = None if others or not stands_out(rest, rule) else _second(rest, first, rule)
    if second is not None:
        first, second, rest = _together(search, first, second, rule)
        chosen, closed, left = [first, second], closed_by(search, rest), rest.sizes()[search.here]
        gain = 1 - float(left.sum() / search.sizes()[search.here].sum())
    share, differs = closed or 0.0, stands_out(rest, rule)  # what cannot be measured cannot be claimed
    if differs and share < rule.nothing:
        return [], None
    part = (differs or closed is not None) and share < rule.whole
    facts = replace(
        facts,
        error=float(search.sizes()[search.here].mean()),
        floor=None if facts.floor is None else float(search.sizes()[~search.here].mean()),
        left=float(left.mean()),
        rest_p=rest.difference.p,
        closed=closed,
        alternatives=tuple(others),
        share=gain,
    )
    kinds = {f.kind for f in findings if f.name in {first.name, *others}}
    if part or any(f.at_bound for f in chosen):
        kind = VerdictKind.PARTLY
    elif kinds == {"base"} and second is None:
        kind = VerdictKind.BASE_PARAMETER
    else:
        kind = VerdictKind.CONFOUNDED if others else VerdictKind.EFFECT
    names = tuple(f.name for f in chosen)
    return chosen, Verdict(kind, (*names, *others), "", facts)


def _second(rest: Search, first: Finding, rule: DecisionRule) -> Finding | None:
    """Find a law in what the first one leaves: one that does more than what may be wrong with the first's response."""
    second = _strongest_physics(rest, rule)
    if second is not None and refine(rest, [second.name]):
        second = _strongest_physics(rest, rule)
    if second is None:
        return None
    least = rule.response_error**2 * float(first.score.explained[1].sum())
    return second if float(second.score.explained[1].sum()) > least else None


def _strongest_physics(search: Search, rule: DecisionRule) -> Finding | None:
    found = [finding_of(score, [], rule) for score in one_per_law(search.scores())]
    return next((f for f in found if f.stands and f.kind == "physics"), None)


def _together(search: Search, first: Finding, second: Finding, rule: DecisionRule) -> tuple[Finding, Finding, Search]:
    """Fit two laws to what the other leaves, in turn (Gauss and Seidel); the last gives what both leave."""
    found = [first, second]
    rest = search
    for turn in range(2 * _TURNS):
        k = turn % 2
        rest = search.beside(found[1 - k].score)
        score = rest.score_of(found[k].score.hypothesis)
        found[k] = finding_of(score, [], rule)
    return found[0], found[1], rest.beside(found[1].score)


def stands_out(search: Search, rule: DecisionRule = RULE) -> bool:
    """Tell whether something else is in the recordings than in the reference, whatever it is."""
    change_p = search.difference.p
    return change_p is not None and change_p <= rule.alarm


def closed_by(before: Search, after: Search, rule: DecisionRule = RULE) -> float | None:
    """Share of the difference to the reference that goes away, held out; None where there is none to speak of.

    It is measured as a smooth field where one stands out and predicts enough of it, else as the size of the error.
    """
    if before.difference.p is None:
        return None
    in_field = before.difference.field_p <= rule.alarm and before.difference.common >= rule.nothing
    was, left = ((s.difference.gain if in_field else s.excess) for s in (before, after))
    return None if was <= 0 else float(1 - max(left, 0.0) / was)


def _dropped(search: Search, scores: Sequence[Score]) -> dict[str, str]:
    """Episodes that could not be followed, and laws that could not be judged, with the reason."""
    where = ("", "reference ")  # both sets may have an episode of the same name
    found = {f"{where[k]}{name}": why for k, table in enumerate(search.tables) for name, why in table.dropped.items()}
    found |= {f"{where[k]}{key}": why for k, table in enumerate(search.tables) for key, why in table.failed.items()}
    ranked, failed = {score.hypothesis.effect for score in scores}, search.failed()
    silent = "it moves nothing that was followed in these recordings"
    laws = dict.fromkeys(c.effect for c in search.candidates if c.effect not in ranked)
    return found | {law: failed.get(law, silent) for law in laws}
