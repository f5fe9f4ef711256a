"""The decision, from scores, shams and intervals."""

from __future__ import annotations

from dataclasses import replace

from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.finding import PARTLY_SHARE, Finding
from plop.diagnosis.judge_base import by_base
from plop.diagnosis.unnamed import may_be_chance, nothing, unnamed
from plop.diagnosis.verdict import Earlier, Grounds, Verdict, VerdictKind
from plop.diagnosis.verdict_text import base_text, both_text, effect_text, parameters_text

SECOND_LEAST = 0.1
"""Least share of what the first law leaves that a second one takes away: the first is never exactly right, and what
is wrong with it resembles other laws."""
PAIR_SHARE = 0.8
"""The same for two laws that only together explain it: they have more amplitudes to do it with."""


def first_of(findings: list[Finding]) -> int | None:
    """Choose the finding that is judged: the best one that is new and that more than one episode shows.

    What has the same amplitude in the reference is not new, whatever it explains here; what one episode alone
    carries says nothing about the others.

    Returns:
        Its place; None when there is none.
    """
    return next((k for k, f in enumerate(findings) if f.differs and not f.carried), None)


def judge(
    findings: list[Finding],
    confounds: list[str],
    base: Finding | None,
    sensors: list[str],
    size: ErrorSize,
    *,
    left: float | None,
    second: tuple[Finding, float] | None = None,
) -> Verdict:
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
    facts = Grounds(tuple(sensors), size.error, size.floor, left, size.excess, size.excess_p, tuple(decoys))
    if sensors:
        text = (
            f"A sensor is off: {'; '.join(sensors)}. The tracks used it, so that physics cannot be judged: mend "
            "it, or leave the camera out (--exclude), and diagnose again."
        )
        return Verdict(VerdictKind.SENSOR, tuple(sensors), text, facts)
    from_base = by_base(base, findings, named[0] if named else None, size, facts)
    if from_base is not None:
        return from_base
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
        return by_base(base, others, None, size, facts) or verdict
    if decoys or size.stands_out:
        return unnamed(VerdictKind.NONE_OF_THESE, findings, facts, size)
    return unnamed(VerdictKind.NOTHING_DETECTABLE, findings, facts, size)


def _law(
    best: Finding,
    alike: list[str],
    second: tuple[Finding, float] | None,
    left: float | None,
    size: ErrorSize,
    facts: Grounds,
) -> Verdict:
    """Name the best law: alone, with the one beside it, or with those that cannot be told from it.

    A law at the end of its range is a part at most: how much more of it there is, nobody knows.
    """
    more = second[0] if second is not None and second[0].passes() and second[0].gain > SECOND_LEAST else None
    if more is not None and second is not None:
        left = second[1]
        facts = replace(facts, left=left)
    share = size.closed(left)
    partly = best.at_bound or (share is not None and share < PARTLY_SHARE)
    others = [name for name in alike if name not in (best.name, more and more.name)]
    if partly and (may_be_chance(size) or (best.kind == "base" and not size.beyond_chance)):
        return nothing(facts, size)
    facts = replace(facts, share=best.gain)
    if more is not None and not others:
        facts = replace(facts, share=1 - (1 - best.gain) * (1 - more.gain))
        text = both_text(best, more, partly, share)
        kind = VerdictKind.PARTLY if partly else VerdictKind.EFFECT
        return Verdict(kind, (best.name, more.name), text, facts)
    kind = VerdictKind.PARTLY if partly else VerdictKind.CONFOUNDED if others else VerdictKind.EFFECT
    if best.kind == "base" and not others and not partly:
        return Verdict(VerdictKind.BASE_PARAMETER, (best.name,), base_text(best), facts)
    facts = replace(facts, alternatives=tuple(others))
    return Verdict(kind, (best.name, *others), effect_text(kind, best, others, share), facts)


def judge_pair(alone: Verdict, first: Finding, second: Finding, left: float, size: ErrorSize) -> Verdict:
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
    each = (
        f"beside the other, the first explains {100 * first.gain:.0f} % of the held-out error, the second "
        f"{100 * second.gain:.0f} %"
    )
    text = (
        f"{start} {first.name} and {second.name}, which were fitted together; "
        f"{parameters_text(first)}; {parameters_text(second)}; {each}; both close {100 * min(share, 1):.0f} % "
        f"of the explainable gap. Add {first.name}, then diagnose again."
    )
    facts = replace(
        alone.evidence,
        left=left,
        error=size.error,
        floor=size.floor,
        alternatives=(),
        share=1 - left / size.error,
        alone=Earlier(alone.kind, alone.named),
    )
    kind = VerdictKind.PARTLY if partly else VerdictKind.EFFECT
    return Verdict(kind, (first.name, second.name), text, facts)
