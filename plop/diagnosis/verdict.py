"""The decision, from scores, shams and intervals; never without its evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from plop.diagnosis.contrast import P_LARGEST
from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.finding import AT_BOUND, CARRIED, ERRORS_LEAST, Finding
from plop.diagnosis.verdict_text import (
    base_text,
    both_text,
    effect_text,
    nearly_text,
    parameters_text,
    partly_base_text,
    unsure_text,
)

PARTLY_SHARE = 0.6
"""Share of the explainable gap below which an effect is named only as a part: most of what a law that is not in the
library does, a neighbour can do as well."""
SECOND_LEAST = 0.1
"""Least share of what the first law leaves that a second one takes away: the first is never exactly right, and what
is wrong with it resembles other laws."""
PAIR_SHARE = 0.8
"""The same for two laws that only together explain it: they have more amplitudes to do it with."""
SHOWN_LEAST = 0.2
"""Least share of the error that a law takes away, fitted to the one episode that shows it, to be told of."""

_NOTHING = "No effect of the library can be detected in these recordings."
_NONE = "Something is missing that the library does not hold."


@dataclass(frozen=True)
class Verdict:
    """What diagnosis says."""

    kind: str
    """NOTHING DETECTABLE, SENSOR, EFFECT, BASE PARAMETER, CONFOUNDED, PARTLY or NONE OF THESE."""
    named: list[str]
    """Effects, base parameters or sensor faults it names; the most likely first."""
    text: str
    """One sentence."""
    evidence: dict[str, Any] = field(default_factory=dict)


def first_of(findings: list[Finding]) -> int | None:
    """Choose the finding that is judged: the best one that is new and that more than one episode shows.

    What has the same amplitude in the reference is not new, whatever it explains here; what one episode alone
    carries says nothing about the others.

    Returns:
        Its place; None when there is none.
    """
    return next((k for k, f in enumerate(findings) if f.differs and not f.carried), None)


def judge(
    findings: list[Finding], confounds: list[str], base: Finding | None, sensors: list[str], size: ErrorSize, *,
    left: float | None, second: tuple[Finding, float] | None = None,
) -> Verdict:  # fmt: skip
    """Decide.

    Args:
        findings: Effects, best first.
        confounds: Effects that cannot be told from the best; decoys and those at their bound are left out.
        base: Change of the base's own parameters.
        sensors: Significant sensor faults, in words.
        size: How large the error is.
        left: Mean squared whitened error with the best effect.
        second: The law that explains most of what the best one leaves, and the error with both.
    """
    named = [f for f in findings if f.passes() and f.kind != "decoy"]
    decoys = [f.name for f in findings[:1] if f.passes() and f.kind == "decoy"]
    facts = {"sensors": sensors, "error": size.error, "floor": size.floor, "left": left, "excess": size.excess,
             "excess_p": size.excess_p, "decoys": decoys, "alternatives": []}  # fmt: skip
    if sensors:
        text = (f"A sensor is off: {'; '.join(sensors)}. The tracks used it, so that physics cannot be judged: mend "
                "it, or leave the camera out (--exclude), and diagnose again.")  # fmt: skip
        return Verdict("SENSOR", sensors, text, facts)
    by_base = _by_base(base, findings, named[0] if named else None, size, facts)
    if by_base is not None:
        return by_base
    chosen = first_of(findings)
    first = None if chosen is None else findings[chosen]
    if first is not None and first.kind == "decoy" and named and named[0].name in confounds:
        first = named[0]  # a decoy that cannot be told from it is no reason to refuse it
    if first is not None and (first in named or (first.ends() and first.kind != "decoy" and size.stands_out)):
        possible = {f.name for f in findings if f.kind != "decoy" and not f.at_bound}
        verdict = _law(first, [name for name in confounds if name in possible], second, left, size, facts)
        if verdict.named:
            return verdict
        others = [f for f in findings if f is not first]  # a law that is refused does not hide the base's parameter
        return _by_base(base, others, None, size, facts) or verdict
    if decoys or size.stands_out:
        return _unnamed("NONE OF THESE", findings, facts)
    return _unnamed("NOTHING DETECTABLE", findings, facts, nearly_text(size))


def judge_pair(
    alone: Verdict, first: Finding, second: Finding, left: float, size: ErrorSize
) -> Verdict:  # fmt: skip
    """Name two laws that were fitted together, where none alone settled it, or two did that were fitted one by one.

    Args:
        alone: What was said without the pair.
        first: One law, its gain a share of what the other leaves.
        second: The other one.
        left: Mean squared whitened error with both.
        size: How large the error is.

    Returns:
        The verdict with both, or the one without where a law fails a test beside the other, or both together close too
        little of the gap: two laws can do much of what a third does that the library does not hold.
    """
    share = size.closed(left)
    both = all(f.kind == "physics" and f.passes() and f.gain > SECOND_LEAST for f in (first, second))
    if not both or share is None or share < PARTLY_SHARE:
        return alone
    partly = share < PAIR_SHARE
    start = "Partly" if partly else "Missing:"
    each = (f"beside the other, the first explains {100 * first.gain:.0f} % of the held-out error, the second "
            f"{100 * second.gain:.0f} %")  # fmt: skip
    text = (f"{start} {first.name} and {second.name}, which were fitted together; "
            f"{parameters_text(first)}; {parameters_text(second)}; {each}; both close {100 * min(share, 1):.0f} % "
            f"of the explainable gap. Add {first.name}, then diagnose again.")  # fmt: skip
    facts = {**alone.evidence, "left": left, "error": size.error, "floor": size.floor, "alternatives": [],
             "alone": {"kind": alone.kind, "named": alone.named}}  # fmt: skip
    return Verdict("PARTLY" if partly else "EFFECT", [first.name, second.name], text, facts)


def among(verdict: Verdict, tried: Sequence[str]) -> Verdict:
    """Let a verdict that names nothing speak of the laws that were tried only: the library was not tried whole."""
    texts = {_NOTHING: "None of the laws that were tried can be detected in these recordings",
             _NONE: "Something is missing that none of the laws that were tried explains"}  # fmt: skip
    start = next((start for start in texts if verdict.text.startswith(start)), None)
    if start is None:
        return verdict
    return replace(verdict, text=f"{texts[start]}: {', '.join(tried)}.{verdict.text.removeprefix(start)}")


def _unnamed(kind: str, findings: list[Finding], facts: dict[str, Any], more: str = "") -> Verdict:
    """Name nothing, but say which law would have been named, if only in part, had more than one episode shown it.

    Args:
        kind: The verdict.
        findings: All laws.
        facts: Evidence.
        more: Is said behind it.
    """
    missing = kind == "NONE OF THESE"
    told = [f for f in findings if f.kind == "physics" and (_carried_only(f) or (missing and _shown_once(f)))]
    lone = max(told, key=lambda f: f.shown, default=None)
    if lone is None and missing and (unsure := [f for f in findings if f.kind == "physics" and f.hardly_differs()]):
        return Verdict(kind, [], unsure_text(max(unsure, key=lambda f: f.gain)), facts)
    if lone is None:
        return Verdict(kind, [], (_NONE if missing else _NOTHING) + more, facts)
    start = "Something is missing" if missing else "No effect can be detected in more than one episode"
    if _carried_only(lone):
        episode, what = lone.helps, f"{lone.name} takes {100 * lone.gain:.0f} % of the held-out error away, but"
    else:
        episode = lone.shown_by
        what = (f"fitted to all episodes, {lone.name} takes {100 * lone.shown:.0f} % of the error away "
                f"({parameters_text(lone)}), but")  # fmt: skip
    text = f"{start}: {what} {episode} alone shows it, so that it is not named.{more}"
    return Verdict(kind, [], text, {**facts, "lone": {"effect": lone.name, "episode": episode}})


def _carried_only(finding: Finding) -> bool:
    """Tell whether nothing but the other episodes, or else the end of its range, is against a law."""
    return CARRIED in finding.reasons() and {*finding.reasons()} <= {CARRIED, AT_BOUND}


def _shown_once(finding: Finding) -> bool:
    """Tell whether one episode shows a law well that, held out, the others cannot predict: they do not hold it."""
    return finding.shown_by != "" and finding.shown >= SHOWN_LEAST and not finding.at_bound


def _law(
    best: Finding, alike: list[str], second: tuple[Finding, float] | None, left: float | None, size: ErrorSize,
    facts: dict[str, Any],
) -> Verdict:  # fmt: skip
    """Name the best law: alone, with the one beside it, or with those that cannot be told from it.

    A law at the end of its range is a part at most: how much more of it there is, nobody knows.
    """
    more = second[0] if second is not None and second[0].passes() and second[0].gain > SECOND_LEAST else None
    if more is not None and second is not None:
        left = second[1]
        facts = {**facts, "left": left}
    share = size.closed(left)
    partly = best.at_bound or (share is not None and share < PARTLY_SHARE)
    others = [name for name in alike if name not in (best.name, more and more.name)]
    if partly and (_may_be_chance(size) or (best.kind == "base" and not size.beyond_chance)):
        return _nothing(facts, size)
    if more is not None and not others:
        text = both_text(best, more, partly, share)
        return Verdict("PARTLY" if partly else "EFFECT", [best.name, more.name], text, facts)
    kind = "PARTLY" if partly else "CONFOUNDED" if others else "EFFECT"
    if best.kind == "base" and not others and not partly:
        return Verdict("BASE PARAMETER", [best.name], base_text(best), facts)
    facts = {**facts, "alternatives": others}
    return Verdict(kind, [best.name, *others], effect_text(kind, best, others, share), facts)


def _may_be_chance(size: ErrorSize) -> bool:
    """Tell whether the gap may be no more than what motions differ by.

    Most of such a gap is nothing that a law or a parameter could have explained.
    """
    return not size.stands_out and size.excess_p is not None and size.excess_p > P_LARGEST


def _nothing(facts: dict[str, Any], size: ErrorSize) -> Verdict:
    return Verdict("NOTHING DETECTABLE", [], _NOTHING + nearly_text(size), facts)


def _by_base(
    base: Finding | None, findings: list[Finding], beyond: Finding | None, size: ErrorSize, facts: dict[str, Any]
) -> Verdict | None:
    """Judge by the base's own parameters where their change passes; None where laws decide. See `_base_or`."""
    if base is None or not base.passes():
        return None
    found, closed = _base_or(base, findings, beyond, size, facts), size.closed_by_base
    if found is not None and base.name in found.named and closed is not None and closed < PARTLY_SHARE:
        if size.beyond_chance or size.stands_out:
            return Verdict("PARTLY", found.named, partly_base_text(base, found.named[1:]), found.evidence)
        if _may_be_chance(size):
            return _nothing(facts, size)
    return found


def _base_or(
    base: Finding, findings: list[Finding], beyond: Finding | None, size: ErrorSize, facts: dict[str, Any]
) -> Verdict | None:
    """Decide between the base parameters fitted along and what explains more by itself; None where laws decide.

    What explains as much by itself as the parameter does, within two standard errors, cannot be told from it.

    Args:
        base: Change of the base's own parameters that are fitted along, which is significant.
        findings: Laws, and the base's other parameters.
        beyond: The best finding that passes beyond the parameters, if any.
        size: How large the error is with them.
        facts: Evidence.
    """
    rivals = [f for f in findings if f.kind != "decoy" and not f.at_bound and f.differs]
    rivals = sorted((f for f in rivals if f.alone > base.gain - _margin(f)), key=lambda f: -f.alone)
    better = next((f for f in rivals if f.alone > base.gain + _margin(f)), None)
    if better is not None and beyond is not None:
        return None
    if better is not None:
        better = replace(better, gain=better.alone)
        if better.kind == "base":
            return Verdict("BASE PARAMETER", [better.name], base_text(better), facts)
        return Verdict("EFFECT", [better.name], effect_text("EFFECT", better, [], None), facts)
    if beyond is not None and beyond.gain * (1 - base.gain) > base.gain / 2:
        return None
    law = next((f for f in rivals if f.kind == "physics"), None)
    if law is not None:
        text = (f"{base.name} of the base, or {law.name}, which these motions cannot tell apart; "
                f"{parameters_text(base)}; or {parameters_text(law)}.")  # fmt: skip
        return Verdict("CONFOUNDED", [base.name, law.name], text, {**facts, "alternatives": [law.name]})
    also = [f.name for f in rivals]
    return Verdict("BASE PARAMETER", [base.name], base_text(base, also, size), {**facts, "alternatives": also})


def _margin(finding: Finding) -> float:
    """How much more or less than the base's parameters a finding may explain by itself by chance."""
    return ERRORS_LEAST * finding.alone_error
