"""The headline of a report: one plain sentence of what is missing, how much of the error that explains, and how sure.

It is made from the verdict's kind, what it names and its figures, never from its prose; the numbers and conditions
behind it stand in the sections below.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from math import exp, sqrt

from plop.diagnosis.error_size import EXCESS_RATIO
from plop.diagnosis.result import Diagnosis, Ranked, SensorFault
from plop.diagnosis.verdict import VerdictKind
from plop.diagnosis.verdict_text import NEARLY_P
from plop.parameters import is_log_change, short_number, with_unit
from plop.sensors.faults.library import FAULTS


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
    return f"what {label} is missing is {what}: {together} {_share(found)} of the error, and {_chance(named)}"


def _partly(label: str, found: Diagnosis) -> str:
    named, alternatives = found.named, found.verdict.evidence.alternatives
    joined = " or ".join(map(_plain, named)) if alternatives else " and ".join(map(_plain, named))
    alike = ", which these motions cannot tell apart" if alternatives else ""
    explain = "they explain" if len(named) > 1 and not alternatives else "it explains"
    if named and named[0].kind == "base":
        rest = "what explains the rest was not found"
    elif any(p.at_bound for row in named for p in row.parameters.values()):
        rest = "there may be more of it than was tried"
    else:
        rest = "much of the error remains unexplained"
    counted = named[:1] if alternatives else named
    return (
        f"part of what is wrong with {label} is {joined}{alike}: {explain} {_share(found)} of the error, "
        f"{_chance(counted)}, and {rest}"
    )


def _base(label: str, found: Diagnosis) -> str:
    named, evidence = found.named, found.verdict.evidence
    others = evidence.alternatives
    what = " or ".join(map(_words, [*found.verdict.named[:1], *others]))
    alike = ", which these motions cannot tell apart," if others else ""
    if evidence.rest is False:
        start, rest = f"no law is missing from {label}, but its {what}{alike} is off", ""
    else:
        start = f"the {what} of {label}{alike} is off"
        rest = ", though what is left is still more than where nothing is missing" if evidence.rest else ""
    factor = "" if others else _factor(named)
    return f"{start}{factor}: changing it explains {_share(found)} of the error, and {_chance(named[:1])}{rest}"


def _confounded(label: str, found: Diagnosis) -> str:
    named = found.named
    wrong = [f"the {_words(row.effect)} of {label} is off" for row in named if row.kind == "base"]
    laws = [_plain(row) for row in named if row.kind != "base"]
    missing = [f"{' or '.join(laws)} is missing from {label}"] if laws else []
    either = " or ".join([*wrong, *missing])
    return (
        f"either {either}, but these motions cannot tell which: either would explain about {_share(found)} of the "
        f"error, and {_chance(named[:1])}"
    )


def _none(label: str, found: Diagnosis) -> str:
    tried, larger = _laws(found), _larger(found)
    if larger is None and (decoys := found.verdict.evidence.decoys):
        return (
            f"nothing that is missing from {label} can be named with any certainty, since what explains the error "
            f"best is {' or '.join(decoys)}, which cannot matter in motions this slow and is tried only as a check"
        )
    lone = _lone(found, "points to")
    explains = lone or f"none of the {len(tried)} laws that were tried explains any of it with certainty"
    size = f": the error is {larger}" if larger else ""
    return f"something is missing from {label}, but {explains}{size}"


def _nothing(label: str, found: Diagnosis) -> str:
    tried = _laws(found)
    limits = [found.limits[row.effect] for row in tried if row.effect in found.limits]
    seen = [1000 * limit.displacement_m for limit in limits if limit.displacement_m is not None]
    blind = sum(limit.amplitude is None for limit in limits)
    larger = _larger(found) if _nearly(found) else None
    parts = [f"nothing that {label} is missing can be detected in these recordings"]
    if lone := _lone(found, "hints at"):
        parts = [f"nothing that {label} is missing can be detected with certainty ({lone})"]
    if seen:
        but = f", except for {blind} of {len(tried)} laws that these motions cannot show" if blind else ""
        least = f"{short_number(max(seen))} mm"
        parts.append(f"what moves the object by more than {least} would have been found about nine times in ten{but}")
    elif tried:
        parts.append("these motions could not have shown any of the laws that were tried")
    joined = ": ".join(parts)
    return f"{joined}, although the error is {larger}" if larger else joined


def _sensor(label: str, found: Diagnosis) -> str:
    sensors = found.sensors or ()
    faults = " and ".join(_fault(s) for s in sensors) or "a camera is faulty"
    surest = max((s.z for s in sensors), default=0.0)
    sure = f", {surest:.0f} times more than noise explains" if surest else ""
    return (
        f"{faults}{sure}, so nothing can be said about what is missing from {label}, or how much of the error that "
        "explains, until it is repaired or left out"
    )


def _fault(sensor: SensorFault) -> str:
    known = FAULTS.get(sensor.fault)
    values = [with_unit(short_number(p.value), p.unit) for p in sensor.values.values()]
    size = f", {values[0]}" if len(values) == 1 else ""
    return f"camera {sensor.camera} is faulty ({known.help if known else _words(sensor.fault)}{size})"


def explained(found: Diagnosis) -> float | None:
    """Share of the held-out error that what the verdict names takes away; None where it names nothing."""
    named, share = found.named, found.verdict.evidence.share
    if share is None and named:
        share = named[0].gain
    return share if named and share is not None and share > 0 else None


def _share(found: Diagnosis) -> str:
    share = explained(found)
    return "an unknown part" if share is None else f"{100 * share:.0f} %"


def _chance(named: Sequence[Ranked]) -> str:
    """Say how often chance would do as much: the largest of the p values, which are shares of permutations."""
    known = [row.p for row in named if row.p is not None]
    if not known or len(known) < len(named):
        return "its significance was not tested"
    return f"by chance alone this would happen {_once(max(known))}"


def _once(p: float) -> str:
    return f"about once in {round(1 / p):,} trials" if p > 0 else "never"


def _larger(found: Diagnosis) -> str | None:
    """Say how many times the error is that of the recordings where nothing is missing; None where it is not larger."""
    floor, p = found.floor, found.verdict.evidence.excess_p
    if floor is None or floor <= 0 or not found.error > EXCESS_RATIO * floor:
        return None
    often = f", which would happen by chance {_once(p)}" if p is not None and p <= NEARLY_P else ""
    return f"{sqrt(found.error / floor):.1f} times as large as in the recordings where nothing is missing{often}"


def _nearly(found: Diagnosis) -> bool:
    p = found.verdict.evidence.excess_p
    return p is not None and p <= NEARLY_P


def _lone(found: Diagnosis, verb: str) -> str:
    lone = found.verdict.evidence.lone
    if lone is None:
        return ""
    row = found.row(lone.effect)
    law = _words(lone.effect) if row is None else _plain(row)
    return f"only {lone.episode} {verb} {law}, which is not enough to name it"


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
