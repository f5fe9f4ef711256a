"""What to do after a verdict, in one or two sentences: a command to type, or a motion to record."""

from __future__ import annotations

from plop.diagnosis.conclusion import Conclusion
from plop.diagnosis.next_motion import next_motion
from plop.diagnosis.verdict import Verdict, VerdictKind
from plop.parameters import short_number, with_unit

_EASIEST = 3
"""Laws whose limits are given where nothing was found."""
_REPEAT = "repeat the motions of the reference recordings: what the model misses anyway then cancels"


def next_step(found: Conclusion) -> str:
    """Say what to do next; the commands are meant for the workspace in which this diagnosis is the latest."""
    verdict, motion = found.verdict, next_motion(found)
    if verdict.kind == VerdictKind.SENSOR:
        return (
            "`plop calibrate` checks the cameras again and says how to repair them; to judge physics without one: "
            "`plop diagnose --exclude CAMERA`. A fault of the tool is repaired where the recordings are made: in its "
            "pose, its mesh or its clock."
        )
    if verdict.kind == VerdictKind.NOTHING_DETECTABLE:
        return _limits(found)
    if verdict.kind == VerdictKind.NONE_OF_THESE:
        return (
            "`plop compare` shows where and when the model fails; write the law that you suspect as a file "
            "(docs/how-to/write-an-effect.md) and try it: `plop diagnose --effect-file FILE`."
        )
    if verdict.evidence.alternatives:
        return motion.text if motion else f"Record motions that distinguish {' and '.join(verdict.named)}."
    return _added(verdict) + (f" {motion.text}" if motion else "")


def _added(verdict: Verdict) -> str:
    """Name the command that adds what was found."""
    first = f"Add it: `plop augment --effect {verdict.named[0]} --diagnosis diagnose@latest --name better`"
    if verdict.kind == VerdictKind.BASE_PARAMETER:
        return f"{first}, or fit the base to these recordings (`plop identify`); then `plop compare --model better`."
    if verdict.kind == VerdictKind.PARTLY or len(verdict.named) > 1:
        return f"{first}; then diagnose again with `--model better`: more is missing than this."
    return f"{first}; then `plop compare --model better` shows how far the error has fallen."


def _limits(found: Conclusion) -> str:
    """Say from where on laws would have been named, those that are seen most easily first."""
    least = found.verdict.evidence.least_p
    if least is None:
        return f"Give reference recordings (--reference), in which nothing is missing; best {_REPEAT}."
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
        f"What would have been named nine times in ten: {seen}; all limits are in the diagnosis. To see weaker "
        f"effects, record more episodes, or {_REPEAT}."
    )
