"""Are the times of a simulated episode seconds? Their size and step, and how fast things would move, tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plop.errors import PlopError
from plop.geometry.rigid import transform_points
from plop.recordings.readers.declared_units import SECONDS
from plop.recordings.readers.mesh.sequence import MeshSequence

LONGEST_STEP_S = 2.0
"""Median step beyond which frames no longer show a motion [s]."""
SPEED_M_S = (3e-4, 3.0)
"""Speed of the fastest motion: slower is a creep test, faster a shot. Robots cut and press at 1 mm/s to 0.3 m/s
(DiSECt's knives 0.05 to 0.11): times a thousand times too long or too short always leave this range [m/s]."""
_STEP_S = (1e-5, LONGEST_STEP_S)
"""Median steps that are offered as right: every step of a simulation to two seconds [s]."""
_STILL_M = 1e-6
_LONGEST_FRAME_STEP = 1000.0
_NAMES = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}


def check_clock(sequence: MeshSequence, path: Path) -> list[str]:
    """Refuse a single frame, and times that are no seconds: frame numbers, or another unit by step or speed.

    Times whose unit a file declares are believed; what is odd about them is noted.

    Args:
        sequence: The episode, times in seconds.
        path: File that holds its arrays; its JSON lies beside it.

    Returns:
        Notes.

    Raises:
        PlopError: Nothing can move, or the times are in another unit; the message names the one that would be right.
    """
    times, steps = sequence.times, np.diff(sequence.times)
    if not len(steps):
        raise PlopError(
            "The episode is too short: nothing moves in it.",
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
        return [f"{odd} The unit of its times is declared, and believed: {_read_as(step, fast)}"] if odd else []
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
            "The times look like frame numbers.",
            where=f"{path}: times",
            expected="seconds",
            found=f"{times[0]:g}, {times[1]:g} ... {times[-1]:g}: whole numbers only",
            fix=f'Divide them by the frame rate, or state it in {side}: "units": '
            f'{{"frames_per_second": 30}}. If they are seconds: "units": {{"time": "s"}}'
            + (', if milliseconds: "ms".' if "ms" in fits else "."),
        )
    if odd is None:
        return []
    if fits:
        fix = f'Convert them to seconds, or state their unit in {side}: "units": {{"time": "{fits[0]}"}}.'
    elif slow > SPEED_M_S[1] and SPEED_M_S[0] < fast / 1000 < SPEED_M_S[1]:
        fix = "They are about 1000 times too short: multiply them by 1000."
    else:
        fix = f'Write them in seconds, or state their unit in {side}: "units": {{"time": ...}}.'
    guess = [_NAMES[unit] for unit in fits] + ["frame numbers"] * (whole and step < _LONGEST_FRAME_STEP)
    raise PlopError(
        odd,
        where=f"{path}: times",
        expected=f"seconds: a median step of at most {LONGEST_STEP_S:g} s, a motion of "
        f"{1000 * SPEED_M_S[0]:g} mm/s to {SPEED_M_S[1]:g} m/s",
        found=_read_as(step, fast) + (f": {' or '.join(guess)}?" if guess else ""),
        fix=f'{fix} Where they are right: "units": {{"time": "s"}}.',
    )


def _read_as(step: float, fast: float) -> str:
    return f"a median step of {step:.4g} s and motions of up to {1000 * fast:.4g} mm/s"


def _speeds(sequence: MeshSequence) -> tuple[float, float]:
    """Give the tool's median speed and the largest of tool and object [m/s]; a possible one where all is still.

    The tool moves as a robot can; an object may be flung away. The object counts where the tool rests.
    """
    corners = np.stack([transform_points(pose, sequence.tool_vertices) for pose in sequence.world_from_tool])
    tool, thing = (np.linalg.norm(np.diff(points, axis=0), axis=-1).max(1) for points in (corners, sequence.vertices))
    moved = tool if (tool > _STILL_M).any() else thing
    moving, steps = moved > _STILL_M, np.diff(sequence.times)
    if not moving.any():
        return SPEED_M_S[0], SPEED_M_S[0]
    return float(np.median((moved / steps)[moving])), float((np.maximum(tool, thing) / steps).max())
