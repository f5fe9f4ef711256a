"""The headline of a report: one plain sentence of what is missing, how much of the error that explains, and how sure.

It is made from the verdict's kind, what it names and its figures, never from its prose; the numbers and conditions
behind it stand in the sections below.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from math import exp

from plop.diagnosis.decision.result import Diagnosis, Ranked, SensorFault
from plop.diagnosis.decision.verdict import VerdictKind
from plop.diagnosis.rule import RULE
from plop.parameters import is_log_change, short_number, with_unit
from plop.sensors.faults.library import ALL_FAULTS, TOOL


def headline(label: str, found: Diagnosis) -> str:
    """Say in one sentence what a diagnosis of the model `label` found."""
    says: dict[VerdictKind, Callable[[str, Diagnosis], str]] = {
        VerdictKind.EFFECT: _effect,
        VerdictKind.PARTLY: _partly,
        VerdictKind.BASE_PARAMETER: _base,
        VerdictKind.CONFOUNDED: _confounded,
        VerdictKind.NONE_OF_THESE: _none,
        VerdictKind.NOTHING_DETECTABLE: _nothing,
        VerdictKind.SENSOR: _sensor,
    }
    sentence = says[found.verdict.kind](label, found)
    return f"{sentence[0].upper()}{sentence[1:]}."


def _effect(label: str, found: Diagnosis) -> str:
    named = found.named
    what = " and ".join(map(_plain, named))
    together = "together they explain" if len(named) > 1 else "it explains"
    return f"what {label} is missing is {what}: {together} {_share(found)}, and {_chance(named)}"


def _partly(label: str, found: Diagnosis) -> str:
    named, alternatives = found.named, found.verdict.evidence.alternatives
    joined = " or ".join(map(_plain, named)) if alternatives else " and ".join(map(_plain, named))
    alike = ", which these motions cannot distinguish" if alternatives else ""
    explain = "they explain" if len(named) > 1 and not alternatives else "it explains"
    bounded = any(p.at_bound for row in named for p in row.parameters.values())
    rest = "there may be more of it than was tried" if bounded else "what explains the rest was not found"
    counted = named[:1] if alternatives else named
    return (
        f"part of what is wrong with {label} is {joined}{alike}: {explain} {_share(found)}, "
        f"{_chance(counted)}, and {rest}"
    )


def _base(label: str, found: Diagnosis) -> str:
    named, evidence = found.named, found.verdict.evidence
    others = evidence.alternatives
    what = " or ".join(map(_words, [*found.verdict.named[:1], *others]))
    alike = ", which these motions cannot distinguish," if others else ""
    left = evidence.rest_p is not None and evidence.rest_p <= RULE.alarm
    start = (
        f"the {what} of {label}{alike} is off"
        if left
        else f"no law is missing from {label}, but its {what}{alike} is off"
    )
    rest = ", though what is left still differs from where nothing is missing" if left else ""
    factor = "" if others else _factor(named)
    return f"{start}{factor}: changing it explains {_share(found)}, and {_chance(named[:1])}{rest}"


def _confounded(label: str, found: Diagnosis) -> str:
    named = found.named
    wrong = [f"the {_words(row.effect)} of {label} is off" for row in named if row.kind == "base"]
    laws = [_plain(row) for row in named if row.kind != "base"]
    missing = [f"{' or '.join(laws)} is missing from {label}"] if laws else []
    either = " or ".join([*wrong, *missing])
    return (
        f"either {either}, but these motions cannot distinguish them: either would explain about {_share(found)}, "
        f"and {_chance(named[:1])}"
    )


def _none(label: str, found: Diagnosis) -> str:
    tried, evidence = _laws(found), found.verdict.evidence
    if evidence.decoys:
        return (
            f"nothing that is missing from {label} can be named with any certainty, since what explains the error "
            f"best is {' or '.join(evidence.decoys)}, which cannot matter in motions this slow and is tried as a check"
        )
    start = f"something is missing from {label} that none of the {len(tried)} laws that were tried explains"
    law = None if evidence.resembles is None else found.row(evidence.resembles)
    if law is not None:
        what = _words(law.effect)
        return f"{start}: it resembles {what}, and {_chance([law])}, but what that leaves still stands out"
    often = "" if evidence.change_p is None else f", and by chance alone this would happen {_once(evidence.change_p)}"
    return f"{start}: the recordings differ from those where nothing is missing{often}"


def _nothing(label: str, found: Diagnosis) -> str:
    tried = _laws(found)
    if not found.verdict.evidence.reference:
        return (
            f"what {label} is missing cannot be named without reference recordings, in which nothing is missing: its "
            "own error looks like a law, too"
        )
    limits = [found.limits[row.effect] for row in tried if row.effect in found.limits]
    seen = [1000 * limit.displacement_m for limit in limits if limit.displacement_m is not None]
    blind = sum(limit.amplitude is None for limit in limits)
    start = f"nothing that {label} is missing can be detected in these recordings"
    if alone := found.verdict.evidence.alone:
        where = " and ".join(alone)
        return f"{start}, but {label} is off far more in {where} than in all others: record that motion again"
    if (shown := found.verdict.evidence.description) is not None:
        often = _once(found.verdict.evidence.change_p or 0.0)
        return (
            f"{start}, but they may differ from those where nothing is missing (by chance alone this would happen "
            f"{often}): record more motions like {shown.motions[0].what}, here and in the reference"
        )
    if seen:
        but = f", except for {blind} of {len(tried)} laws that these motions cannot show" if blind else ""
        size = f"{short_number(max(seen))} mm"
        return f"{start}: what moves the object by more than {size} would have been found about nine times in ten{but}"
    return f"{start}: these motions could not have shown any of the laws that were tried" if tried else start


def _sensor(label: str, found: Diagnosis) -> str:
    sensors = found.sensors or ()
    faults = " and ".join(_fault(s) for s in sensors) or "a camera is faulty"
    surest = max((s.z for s in sensors), default=0.0)
    sure = f", {surest:.0f} times more than noise explains" if surest else ""
    named = found.verdict.evidence.physics_named
    seen = f"{' and '.join(map(_words, named))} seems to be missing" if named else "nothing certain"
    return (
        f"{faults}{sure}, so what is missing from {label}, and how much of the error that explains, can only be said "
        f"when it is repaired or left out; as the tracks are, they show {seen}"
    )


def _fault(sensor: SensorFault) -> str:
    known = ALL_FAULTS.get(sensor.fault)
    values = [with_unit(short_number(p.value), p.unit) for p in sensor.values.values()]
    size = f", {values[0]}" if len(values) == 1 else ""
    what = sensor.camera if sensor.camera == TOOL else f"camera {sensor.camera}"
    return f"{what} is faulty ({known.help if known else _words(sensor.fault)}{size})"


def explained(found: Diagnosis) -> float | None:
    """Share of the held-out error that what the verdict names takes away; None where it names nothing."""
    named, share = found.named, found.verdict.evidence.share
    if share is None and named:
        share = named[0].gain
    return share if named and share is not None and share > 0 else None


def _share(found: Diagnosis) -> str:
    """Say how much is explained: of the difference to the reference where there is one, else of the error."""
    closed, share = found.verdict.evidence.closed, explained(found)
    if found.named and closed is not None:
        return f"{100 * min(max(closed, 0), 1):.0f} % of the difference to the recordings where nothing is missing"
    return "an unknown part of the error" if share is None else f"{100 * share:.0f} % of the error"


def _chance(named: Sequence[Ranked]) -> str:
    """Say how often chance would do as much."""
    return f"by chance alone this would happen {_once(max((row.p for row in named), default=1.0))}"


def _once(p: float) -> str:
    return f"about once in {round(1 / p):,} trials" if p > 0 else "never"


def _laws(found: Diagnosis) -> list[Ranked]:
    return [row for row in found.ranking if row.kind == "physics"]


def _plain(row: Ranked) -> str:
    """Name a law with what it is, e.g. "adhesion (the tool is sticky and lets go late)"; a base parameter by itself."""
    if row.kind == "base":
        return f"its {_words(row.effect)}"
    what = re.split(r"[.!?](?:\s|$)", row.help.strip())[0]  # of a user's law the first sentence
    return _words(row.effect) + (f" ({what})" if what else "")


def _factor(named: Sequence[Ranked]) -> str:
    """Say by what factor a base parameter changes, where the recordings determine it."""
    for name, p in (named[0].parameters if named else {}).items():
        if is_log_change(name) and p.determined:
            return f" (it should be {short_number(exp(p.value))} times as large)"
    return ""


def _words(name: str) -> str:
    return name.replace("_", " ")
