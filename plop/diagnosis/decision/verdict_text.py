"""The sentence of a verdict, made from its typed parts."""

from __future__ import annotations

import math
from collections.abc import Sequence

from plop.diagnosis.decision.finding import Finding
from plop.diagnosis.decision.verdict import Grounds, Verdict, VerdictKind
from plop.diagnosis.evidence.description import description_text
from plop.diagnosis.rule import RULE
from plop.parameters import estimate_text, is_log_change, short_number


def verdict_text(verdict: Verdict, findings: Sequence[Finding], tried: Sequence[str] | None = None) -> str:
    """Write the sentence.

    Args:
        verdict: It, but for its text.
        findings: All laws; what is named comes first.
        tried: Names of the laws, where these are not the whole library.
    """
    facts = verdict.evidence
    if verdict.kind == VerdictKind.SENSOR:
        return _sensor(facts)
    if verdict.kind == VerdictKind.NOTHING_DETECTABLE:
        return _nothing(facts, findings, tried)
    if verdict.kind == VerdictKind.NONE_OF_THESE:
        return _none(facts, findings, tried)
    count = len(verdict.named) - len(facts.alternatives)
    return f"{_start(verdict)} {_what(findings[:count], facts)}; {_size(facts)}{_sure(findings[:count], facts)}."


def _sensor(facts: Grounds) -> str:
    named = f" ({', '.join(facts.physics_named)})" if facts.physics_named else ""
    return (
        f"A sensor is off: {'; '.join(facts.sensors)}. The tracks rest on it; as they are they say "
        f"{facts.physics}{named}, which counts only if it stands with the fault repaired, or the camera left out "
        "(--exclude)."
    )


def _start(verdict: Verdict) -> str:
    return {
        VerdictKind.EFFECT: "Missing:",
        VerdictKind.PARTLY: "Partly",
        VerdictKind.CONFOUNDED: "Missing:",
        VerdictKind.BASE_PARAMETER: "No law is missing; a parameter of the base differs:",
    }[verdict.kind]


def _what(named: Sequence[Finding], facts: Grounds) -> str:
    each = [f"{f.name} ({change_text(f)}{_end(f)})" for f in named]
    others = facts.alternatives
    either = f", or {' or '.join(others)}, which these motions cannot distinguish" if others else ""
    return " and ".join(each) + either


def _size(facts: Grounds) -> str:
    share = f"it explains {100 * (facts.share or 0):.0f} % of the held-out squared error"
    if facts.closed is None:
        return share
    closed = f"{100 * min(max(facts.closed, 0), 1):.0f} % of the difference to the reference recordings"
    return f"{share} and {closed}"


def _sure(named: Sequence[Finding], facts: Grounds) -> str:
    p = max(f.score.p for f in named)
    often = f"; where nothing is hidden as much is found in {short_number(100 * p)} % of searches"
    rest = ""
    if facts.rest_p is not None and facts.rest_p <= 0.01 and facts.closed is not None and facts.closed < 1:
        rest = "; what is left still stands out"
    return often + rest


def _nothing(facts: Grounds, findings: Sequence[Finding], tried: Sequence[str] | None) -> str:
    if not facts.reference:
        best = findings[0] if findings else None
        near = f" {best.name} explains most ({100 * best.gain:.0f} %)." if best is not None and best.gain > 0 else ""
        return (
            "Nothing can be named without reference recordings: what the model misses anyway looks like a law, too."
            + near
        )
    odd = f" Explained far less well than the others: {', '.join(facts.alone)}." if facts.alone else ""
    perhaps = ""
    if facts.description is not None:
        chance = f"p = {short_number(facts.change_p or 0.0)}; {RULE.alarm:g} is asked for"
        perhaps = f" They may differ from the reference ({chance}).{description_text(facts.description)}"
    if tried is None:
        return f"No law of the library can be detected in these recordings.{odd}{perhaps}"
    return f"None of the laws that were tried can be detected in these recordings: {', '.join(tried)}.{odd}{perhaps}"


def _none(facts: Grounds, findings: Sequence[Finding], tried: Sequence[str] | None) -> str:
    if facts.decoys:
        return (
            f"Nothing can be named: {facts.decoys[0]} explains most, which cannot matter in such motions and is tried "
            "only as a check."
        )
    best = next((f for f in findings if f.gain > 0), None)
    near = f" The nearest is {best.name}, which explains {100 * best.gain:.0f} %." if best else ""
    what = (
        "the library does not hold"
        if tried is None
        else f"none of the laws that were tried explains ({', '.join(tried)})"
    )
    shown = "" if facts.description is None else description_text(facts.description)
    return f"Something is missing that {what}: {_certain(facts, findings)}.{near}{shown}"


def _certain(facts: Grounds, findings: Sequence[Finding]) -> str:
    """Say why something is missing: the recordings differ, or a law is found that leaves what stands out."""
    law = next((f for f in findings if f.name == facts.resembles), None)
    if law is not None:
        chance = f"as much is found in {short_number(100 * law.score.p)} % of searches"
        return f"it resembles {law.name} (where nothing is hidden {chance}), but what that leaves still stands out"
    p = "" if facts.change_p is None else f" (p = {short_number(facts.change_p)})"
    return f"the recordings differ from the reference{p}"


def parameters_text(finding: Finding) -> str:
    """Write parameters with intervals and units."""
    return ", ".join(estimate_text(name, p) for name, p in finding.parameters.items())


def change_text(finding: Finding) -> str:
    """Write what was fitted: the change of a logarithm as a factor, too."""
    name, change = next(iter(finding.parameters.items()))
    if not is_log_change(name):
        return parameters_text(finding)
    value, low, high = map(math.exp, (change.value, change.low, change.high))
    interval = f" ({short_number(low)} to {short_number(high)})" if change.bounded else ""
    return f"x {short_number(value)}{interval}, {parameters_text(finding)}"


def _end(finding: Finding) -> str:
    return ", the end of its range: there may be more of it" if finding.at_bound else ""
