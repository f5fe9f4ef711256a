"""What to do after a verdict, in one or two sentences: a command to type."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from plop.diagnosis.decision.conclusion import Conclusion
from plop.diagnosis.decision.result import SensorFault
from plop.diagnosis.decision.verdict import Verdict, VerdictKind
from plop.diagnosis.evidence.contrast import roots
from plop.diagnosis.rule import RULE
from plop.parameters import short_number, with_unit
from plop.sensors.faults.clock_offset import ClockOffset

_EASIEST = 3
"""Laws whose limits are given where nothing was found."""
_SAME = 0.001
"""Gains that differ by less differ by the engine's arithmetic alone: laws that only resemble each other differ more."""
_PLAN = "`plop plan --diagnosis diagnose@latest`"
_REPEAT = "repeat the motions of the reference recordings: what the model misses anyway then cancels"


def next_step(found: Conclusion, sensors: Sequence[SensorFault] = ()) -> str:
    """Say what to do next; the commands are meant for the workspace in which this diagnosis is the latest."""
    verdict = found.verdict
    if verdict.kind == VerdictKind.SENSOR:
        return _repaired(sensors)
    if verdict.kind == VerdictKind.NOTHING_DETECTABLE:
        return _limits(found)
    if verdict.kind == VerdictKind.NONE_OF_THESE:
        return (
            "`plop compare` shows where and when the model fails; write the law that you suspect as a file "
            "(docs/how-to/write-an-effect.md) and try it: `plop diagnose --effect-file FILE`."
        )
    if verdict.evidence.alternatives:
        if _equal(found):
            return (
                f"{' and '.join(verdict.named)} do the same in every motion, so that no recording of it distinguishes "
                "them; a measurement of another kind does, as weighing the object distinguishes stiffness and density."
            )
        laws = " from ".join((verdict.named[0], " and ".join(verdict.evidence.alternatives)))
        return f"{_PLAN} names the motion that distinguishes {laws}, and how often to record it."
    unsettled = f" Its setting is not determined: {_PLAN} names the motion that would." if found.rivals else ""
    return _added(verdict) + unsettled


def _equal(found: Conclusion) -> bool:
    """Tell whether all that is named does the same in each recording, but for the arithmetic."""
    first, *others = (found.gains[law] for law in found.verdict.named)
    return all(np.allclose(first, other, rtol=_SAME, atol=_SAME * np.abs(first).max()) for other in others)


def _repaired(sensors: Sequence[SensorFault]) -> str:
    """Name the command that puts the faults right, or leaves a camera out."""
    late = {fault.camera for fault in sensors if fault.fault == ClockOffset.name}
    mended = [fault for fault in sensors if fault.camera not in late]
    exclude = f"leave {' and '.join(sorted(late))} out (`plop diagnose --exclude {','.join(sorted(late))}`)"
    if not mended:
        return f"Images cannot be taken again at other times: {exclude}."
    typed = ",".join(text for fault in mended for text in fault.typed())
    also = f", and {exclude}" if late else ""
    return (
        f"Put it right: `plop repair --recordings RECORDINGS --fault {typed}`{also}; then diagnose what it writes. If "
        "the reference recordings have the fault, too: the same for them, and fit the model again."
    )


def _added(verdict: Verdict) -> str:
    """Name the command that adds what was found."""
    first = f"Add it: `plop augment --effect {verdict.named[0]} --diagnosis diagnose@latest --name better`"
    if verdict.kind == VerdictKind.BASE_PARAMETER:
        return f"{first}, or fit the base to these recordings (`plop identify`); then `plop compare --model better`."
    if verdict.kind == VerdictKind.PARTLY or len(verdict.named) > 1:
        return f"{first}; then diagnose again with `--model better`: more is missing than this."
    return f"{first}; then `plop compare --model better` shows how far the error has fallen."


def _near(found: Conclusion) -> str:
    """Name the law that comes near to a verdict, and the motions that would show it; empty where none does.

    A law that few of the recorded motions show cannot be certain, however large it is: only more of them can tell it
    from a motion that goes differently each time.
    """
    first = next((f for f in found.findings if f.kind != "decoy"), None)
    if first is None or first.score.p > RULE.alike:
        return ""
    gains = roots(first.score.recorded)
    names = [e.name for e, gain in zip(found.search.evidence, gains, strict=False) if 2 * gain >= gains.max()]
    return (
        f"{first.name} comes near to a verdict: where nothing is hidden as much is found in "
        f"{short_number(100 * first.score.p)} % of searches. Most of it is in {' and '.join(names)}: record "
        f"{'that motion' if len(names) == 1 else 'these motions'} again, here and in the reference."
    )


def _limits(found: Conclusion) -> str:
    """Say from where on laws would have been named, those that are seen most easily first."""
    if not found.verdict.evidence.reference:
        return f"Give reference recordings (--reference), in which nothing is missing; best {_REPEAT}."
    if found.verdict.evidence.alone:
        names = " and ".join(found.verdict.evidence.alone)
        return (
            f"Look at {names} (`plop compare`), and record that motion again, here and in the reference: one recording "
            "is no proof, two that differ alike are."
        )
    if near := _near(found):
        return near
    if shown := found.verdict.evidence.description:
        return (
            f"The recordings may differ from the reference, by what is not known: record more motions like "
            f"{shown.motions[0].what}, here and in the reference."
        )
    laws = {f.name for f in found.findings if f.kind == "physics"}
    known = [
        (limit.displacement_m, name, limit)
        for name, limit in found.limits.items()
        if limit.displacement_m is not None and name in laws
    ]
    ease = sorted(known, key=lambda entry: entry[:2])[:_EASIEST]
    if not ease:
        return f"These motions show no law of the library; record larger or faster ones, or {_REPEAT}."
    seen = ", ".join(
        f"{name} from {with_unit(short_number(abs(limit.amplitude or 0.0)), limit.unit)} on "
        f"({short_number(1000 * size)} mm)"
        for size, name, limit in ease
    )
    return (
        f"What would have been named nine times in ten: {seen}; all limits are in the diagnosis. `plop plan` "
        f"says how many recordings show a weaker one; best {_REPEAT}."
    )
