"""Check that the times of a simulated episode are seconds, by their size, their step and the resulting speeds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plop.errors import PlopError
from plop.geometry.rigid import transform_points
from plop.recordings.readers.declared_units import SECONDS
from plop.recordings.readers.mesh.sequence import MeshSequence

LONGEST_STEP_S = 2.0
"""Largest median step of frames that resolve a motion [s]."""
SPEED_M_S = (3e-4, 3.0)
"""Plausible speed of the fastest motion: slower is a creep test, faster an impact. Robots cut and press at 1 mm/s to
0.3 m/s (DiSECt's knives 0.05 to 0.11): times wrong by a factor of 1000 are always outside this range [m/s]."""
_STEP_S = (1e-5, LONGEST_STEP_S)
"""Median steps of a suggested unit: from every step of a simulation to two seconds [s]."""
_STILL_M = 1e-6
_LONGEST_FRAME_STEP = 1000.0
_NAMES = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}


def check_clock(sequence: MeshSequence, path: Path) -> list[str]:
    """Reject a single frame, and times that are not seconds: frame numbers, or another unit by step or speed.

    Times with a declared unit are accepted; unusual values are noted.

    Args:
        sequence: The episode, times in seconds.
        path: File with its arrays; its JSON is beside it.

    Returns:
        Notes.

    Raises:
        PlopError: There is one frame only, or the times are in another unit; the message names the plausible one.
    """
    times, steps = sequence.times, np.diff(sequence.times)
    if not len(steps):
        raise PlopError(
            "The episode is too short.",
            where=f"{path}: times",
            expected="2 frames or more",
            found="1 frame",
            fix="Record it again, or leave it out with --skip-bad.",
        )
    step, (slow, fast) = float(np.median(steps)), _speeds(sequence)
    odd = (
        "The frames are too far apart in time."
        if step > LONGEST_STEP_S
        else "Everything moves too slowly for these times."
        if fast < SPEED_M_S[0]
        else "The tool moves too fast for these times."
        if slow > SPEED_M_S[1]
        else None
    )
    if "time" in sequence.declared:
        return (
            [f"{odd} The unit of its times is declared and therefore accepted: {_read_as(step, fast)}"] if odd else []
        )
    side, whole = path.with_suffix(".json").name, bool((times == np.round(times)).all())
    fits = [
        unit
        for unit, length in SECONDS.items()
        if unit != "s"
        and _STEP_S[0] <= step * length <= _STEP_S[1]
        and fast / length >= SPEED_M_S[0]
        and slow / length <= SPEED_M_S[1]
    ]
    if whole and step <= LONGEST_STEP_S:
        raise PlopError(
            "The times seem to be frame numbers.",
            where=f"{path}: times",
            expected="seconds",
            found=f"{times[0]:g}, {times[1]:g} ... {times[-1]:g}: whole numbers only",
            fix=f'Divide them by the frame rate, or declare it in {side}: "units": '
            f'{{"frames_per_second": 30}}. If they are seconds: "units": {{"time": "s"}}'
            + (', if milliseconds: "ms".' if "ms" in fits else "."),
        )
    if odd is None:
        return []
    if fits:
        fix = f'Convert them to seconds, or declare their unit in {side}: "units": {{"time": "{fits[0]}"}}.'
    elif slow > SPEED_M_S[1] and SPEED_M_S[0] < fast / 1000 < SPEED_M_S[1]:
        fix = "They are about 1000 times too short: multiply them by 1000."
    else:
        fix = f'Write them in seconds, or declare their unit in {side}: "units": {{"time": ...}}.'
    guess = [_NAMES[unit] for unit in fits] + ["frame numbers"] * (whole and step < _LONGEST_FRAME_STEP)
    raise PlopError(
        odd,
        where=f"{path}: times",
        expected=f"seconds: a median step of at most {LONGEST_STEP_S:g} s, a motion of "
        f"{1000 * SPEED_M_S[0]:g} mm/s to {SPEED_M_S[1]:g} m/s",
        found=_read_as(step, fast) + (f": {' or '.join(guess)}?" if guess else ""),
        fix=f'{fix} If they are right: "units": {{"time": "s"}}.',
    )


def _read_as(step: float, fast: float) -> str:
    return f"a median step of {step:.4g} s and motions of up to {1000 * fast:.4g} mm/s"


def _speeds(sequence: MeshSequence) -> tuple[float, float]:
    """Return the tool's median speed and the largest of tool and object [m/s]; a plausible one if nothing moves.

    The tool moves like a robot; an object may be thrown away. The object is used if the tool rests.
    """
    corners = np.stack([transform_points(pose, sequence.tool_vertices) for pose in sequence.world_from_tool])
    tool, thing = (np.linalg.norm(np.diff(points, axis=0), axis=-1).max(1) for points in (corners, sequence.vertices))
    moved = tool if (tool > _STILL_M).any() else thing
    moving, steps = moved > _STILL_M, np.diff(sequence.times)
    if not moving.any():
        return SPEED_M_S[0], SPEED_M_S[0]
    return float(np.median((moved / steps)[moving])), float((np.maximum(tool, thing) / steps).max())
