"""Variations of a recorded tool motion: shifted, rotated, faster or slower, shorter or longer.

A recorded motion shows how the robot moves this tool; a simulator can run similar motions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from plop.geometry.meshes.tool import ToolGeometry
from plop.geometry.rigid import pose_from_euler_xyz
from plop.physics.engine.tool_motion import ToolMotion
from plop.setting_kinds import Range, Settings, Unit

_ASIDE = 0.15
"""Largest shift along the object's extents, as a share of them [-]."""
_CLEAR_M = 0.001
"""Largest distance between the tool's box and a point of the object that counts as contact [m]."""
_TRIES = 20


@dataclass(frozen=True)
class VariationRanges(Settings):
    """How far motions may differ from the recorded ones; the defaults are defined only here."""

    reach: Annotated[float, Range(0, 10)] = 1.6
    """Largest factor of the path along the table; the smallest is 0.5."""
    speed: Annotated[float, Range(1, 10)] = 1.4
    """Largest factor of the speed; the smallest is its inverse."""
    turn_deg: Annotated[float, Range(0, 180), Unit("deg")] = 20.0
    """Largest rotation about the vertical through the object's middle."""


@dataclass(frozen=True)
class Variation:
    """One change of a motion."""

    reach: float
    """Factor of the path along the table since the first frame; heights are kept [-]."""
    speed: float
    """Factor of the speed [-]."""
    turn_rad: float
    """Rotation of the whole motion about the vertical through the object's middle [rad]."""
    aside_m: tuple[float, float]
    """Shift of the whole motion along x and y [m]."""


def another_motion(
    motion: ToolMotion, points: np.ndarray, ranges: VariationRanges, generator: np.random.Generator
) -> ToolMotion:
    """Draw a variation of a recorded motion without more contact at the first frame.

    Args:
        motion: As recorded.
        points: The object at the first frame, [N, 3] [m].
        ranges: Largest differences.
        generator: Source of the draws.

    Returns:
        The motion, at frames with the median time step of the recorded ones.
    """
    touched = _touched(motion, points)
    for _ in range(_TRIES):
        found = varied(motion, points, _drawn(points, ranges, generator))
        if _touched(found, points) <= touched:
            return found
    kept = _drawn(points, ranges, generator)
    return varied(motion, points, Variation(kept.reach, kept.speed, 0.0, (0.0, 0.0)))


def varied(motion: ToolMotion, points: np.ndarray, change: Variation) -> ToolMotion:
    """Change a motion.

    Args:
        motion: As recorded.
        points: The object at the first frame, [N, 3] [m].
        change: What to change.

    Returns:
        The motion, at frames with the median time step of the recorded ones.
    """
    step_s = float(np.median(np.diff(motion.times)))
    frames = max(2, 1 + round(float(np.ptp(motion.times)) / change.speed / step_s))
    recorded = motion.times[0] + change.speed * step_s * np.arange(frames)
    poses, _, _ = motion.at(np.minimum(recorded, motion.times[-1]))
    start = motion.world_from_tool[0, :2, 3]
    poses[:, :2, 3] = start + change.reach * (poses[:, :2, 3] - start)
    middle = np.append(points[:, :2].min(0) + np.ptp(points[:, :2], axis=0) / 2, 0.0)
    turn = pose_from_euler_xyz(np.array([0, 0, 0, 0, 0, change.turn_rad]))
    turn[:3, 3] = middle - turn[:3, :3] @ middle + [*change.aside_m, 0.0]
    return ToolMotion(motion.vertices, motion.faces, motion.times[0] + step_s * np.arange(frames), turn @ poses)


def _drawn(points: np.ndarray, ranges: VariationRanges, generator: np.random.Generator) -> Variation:
    """Draw a change; half of the motions keep their direction."""
    most = np.radians(ranges.turn_deg)
    extent = np.ptp(points[:, :2], axis=0)
    speed = np.exp(generator.uniform(-1, 1) * np.log(ranges.speed))
    turn = generator.choice([0.0, generator.uniform(-most, most)])
    aside = generator.uniform(-_ASIDE, _ASIDE, 2) * extent
    return Variation(generator.uniform(min(0.5, ranges.reach), ranges.reach), speed, turn, (aside[0], aside[1]))


def _touched(motion: ToolMotion, points: np.ndarray) -> int:
    """Count the points of the object inside the tool's box at the first frame."""
    tool = ToolGeometry.from_mesh(motion.vertices, motion.faces)
    pose = motion.world_from_tool[0]
    in_tool = (points - pose[:3, 3]) @ pose[:3, :3]
    local = (in_tool - tool.center.double().numpy()) @ tool.axes.double().numpy()
    return int((np.abs(local) <= tool.half_extent.double().numpy() + _CLEAR_M).all(1).sum())
