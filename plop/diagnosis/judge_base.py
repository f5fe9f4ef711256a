"""Whether the base's own parameters, which are fitted along with every law, explain the error by themselves."""

from __future__ import annotations

from dataclasses import replace

from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.finding import ERRORS_LEAST, PARTLY_SHARE, Finding
from plop.diagnosis.unnamed import may_be_chance, nothing
from plop.diagnosis.verdict import Grounds, Verdict, VerdictKind
from plop.diagnosis.verdict_text import base_text, effect_text, parameters_text, partly_base_text, rest_stands_out


def by_base(
    base: Finding | None, findings: list[Finding], beyond: Finding | None, size: ErrorSize, facts: Grounds
) -> Verdict | None:
    """Judge by the base's own parameters where their change passes; None where laws decide. See `_base_or`."""
    if base is None or not base.passes():
        return None
    found, closed = _base_or(base, findings, beyond, size, facts), size.closed_by_base
    if found is not None and base.name in found.named and closed is not None and closed < PARTLY_SHARE:
        if size.beyond_chance or size.stands_out:
            return Verdict(VerdictKind.PARTLY, found.named, partly_base_text(base, found.named[1:]), found.evidence)
        if may_be_chance(size):
            return nothing(facts, size)
    return found


def _base_or(
    base: Finding, findings: list[Finding], beyond: Finding | None, size: ErrorSize, facts: Grounds
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
        facts = replace(facts, share=better.gain)
        if better.kind == "base":
            return Verdict(VerdictKind.BASE_PARAMETER, (better.name,), base_text(better), facts)
        kind = VerdictKind.EFFECT
        return Verdict(kind, (better.name,), effect_text(kind, better, [], None), facts)
    if beyond is not None and beyond.gain * (1 - base.gain) > base.gain / 2:
        return None
    facts = replace(facts, share=base.gain)
    law = next((f for f in rivals if f.kind == "physics"), None)
    if law is not None:
        text = (
            f"{base.name} of the base, or {law.name}, which these motions cannot tell apart; "
            f"{parameters_text(base)}; or {parameters_text(law)}."
        )
        return Verdict(VerdictKind.CONFOUNDED, (base.name, law.name), text, replace(facts, alternatives=(law.name,)))
    also = [f.name for f in rivals]
    facts = replace(facts, alternatives=tuple(also), rest=rest_stands_out(size))
    return Verdict(VerdictKind.BASE_PARAMETER, (base.name,), base_text(base, also, size), facts)


def _margin(finding: Finding) -> float:
    """How much more or less than the base's parameters a finding may explain by itself by chance."""
    return ERRORS_LEAST * finding.alone_error
