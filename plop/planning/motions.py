"""Motions that may be recorded: those that were recorded, and each of them with its path changed in one way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from plop.diagnosis.evidence.evidence import Evidence
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.varied_motion import Variation, varied
from plop.tracking.episode import Episode
from plop.tracking.hidden_points import tool_distance
from plop.tracking.phases import motion_kind

REST_S = 0.5
"""Rest of a motion that is to rest [s]: longer than most times over which soft matter relaxes in a recording."""
_FACTOR = {"slower": 0.5, "faster": 2.0, "farther": 1.5, "deeper": 4 / 3}
_TRAVELS = 0.1
"""Share of the object's size by which a tool must move along the table for that path to be changed."""
_LEFT = 0.3
"""Share of the object's height that a deeper press leaves under the tool."""
_BOTTOM_M = 0.001
"""A tool this close to its lowest place is there [m]."""
_TOUCH_M = 0.002
"""A tool this close to the object touches it [m]."""
_FAR = 10.0
"""Distance of paths at which motions have nothing in common [object sizes]."""


class Change(StrEnum):
    """How a motion differs from a recorded one."""

    NONE = "as recorded"
    SLOWER = "half as fast"
    FASTER = "twice as fast"
    FARTHER = "half as far again along the table"
    DEEPER = "a third deeper"
    RESTING = "with a rest of half a second before the tool is lifted"
    REVERSED = "from the opposite side"


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion that can be made as often as wanted, and what the engine says of it."""

    name: str
    like: str
    """The recorded episode from which it is made."""
    change: Change
    tool: ToolMotion
    kind: str
    """Kind of motion, see `motion_kind`."""
    evidence: Evidence
    base: np.ndarray
    """Responses of the base's own parameters, [F, K, 3, P] [m]."""
    responses: tuple[np.ndarray, ...]
    """Of each hypothesis, [F, K, 3] [m]."""


def motion_name(like: str, change: Change) -> str:
    """Name a motion, e.g. "block_002, half as fast"."""
    return f"{like}, {change}"


def planned_episode(like: Episode, change: Change) -> Episode | None:
    """Make the episode in which a changed motion would be recorded, the object as it was before.

    Args:
        like: The recorded episode.
        change: How its motion is changed.

    Returns:
        An episode whose points stand still, as they are not measured yet; None where the change makes no sense for
        this motion: it would do nothing, begin in contact, miss the object, or go through it.
    """
    tool = _changed(like, change)
    if tool is None or not _usable(like, tool):
        return None
    frames = len(tool.times)
    now = np.linspace(0, len(like.times) - 1, frames).round().astype(int)  # the same share of the motion
    return replace(
        like,
        name=motion_name(like.name, change),
        times=tool.times,
        points=np.repeat(like.points[:1], frames, 0),
        tool=tool,
        seen=None if like.seen is None else like.seen[now],
    )


def _changed(like: Episode, change: Change) -> ToolMotion | None:
    tool, start = like.tool, like.vertices
    if change in (Change.SLOWER, Change.FASTER):
        return varied(tool, start, Variation(1.0, _FACTOR[change.name.lower()], 0.0, (0.0, 0.0)))
    if change in (Change.FARTHER, Change.REVERSED):
        if _travelled(tool) < _TRAVELS * float(np.ptp(start, axis=0).max()):
            return None
        reach, turn = (_FACTOR["farther"], 0.0) if change == Change.FARTHER else (1.0, np.pi)
        return varied(tool, start, Variation(reach, 1.0, turn, (0.0, 0.0)))
    return _deeper(like) if change == Change.DEEPER else _resting(tool)


def _deeper(like: Episode) -> ToolMotion | None:
    """Let a press go deeper; a push has no depth, and a cut goes through anyway."""
    if not motion_kind(like).startswith("press"):
        return None
    poses, height = like.tool.world_from_tool.copy(), np.ptp(like.vertices[:, 2])
    poses[:, 2, 3] = poses[0, 2, 3] + _FACTOR["deeper"] * (poses[:, 2, 3] - poses[0, 2, 3])
    tool = replace(like.tool, world_from_tool=poses)
    return None if _lowest(tool).min() < like.vertices[:, 2].min() + _LEFT * height else tool


def _resting(tool: ToolMotion) -> ToolMotion:
    """Let the tool rest at the last moment at which it is at its lowest place."""
    lowest = _lowest(tool)
    last = int(np.flatnonzero(lowest < lowest.min() + _BOTTOM_M)[-1])
    step_s = float(np.median(np.diff(tool.times)))
    frames = round(REST_S / step_s)
    times = np.concatenate([tool.times[: last + 1], tool.times[last] + step_s * np.arange(1, frames + 1)])
    times = np.concatenate([times, tool.times[last + 1 :] + frames * step_s])
    which = np.concatenate([np.arange(last + 1), np.full(frames, last), np.arange(last + 1, len(tool.times))])
    return replace(tool, times=times, world_from_tool=tool.world_from_tool[which])


def _lowest(tool: ToolMotion) -> np.ndarray:
    """Height of the tool's lowest point at each frame, [T] [m]."""
    corners = tool.vertices @ tool.world_from_tool[:, :3, :3].transpose(0, 2, 1) + tool.world_from_tool[:, None, :3, 3]
    return np.asarray(corners[..., 2].min(1))


def _travelled(tool: ToolMotion) -> float:
    """Largest distance along the table from where the tool started [m]."""
    return float(np.linalg.norm(tool.world_from_tool[:, :2, 3] - tool.world_from_tool[0, :2, 3], axis=1).max())


def _usable(like: Episode, tool: ToolMotion) -> bool:
    """Tell whether a motion begins apart from the object, as the recorded one does, and then touches it."""
    distance = [float(tool_distance(tool, frame, like.points[0]).min()) for frame in range(len(tool.times))]
    recorded = float(tool_distance(like.tool, 0, like.points[0]).min())
    return distance[0] >= min(recorded, _TOUCH_M) and min(distance) < _TOUCH_M


def elsewhere(motion: Motion, number: int) -> Motion:
    """Let a motion have a path of its own, far from all others: what the base misses in it is unlike theirs."""
    path = motion.evidence.tool_path + _FAR * (number + 1)
    return replace(motion, evidence=replace(motion.evidence, tool_path=path))


def as_expected(planned: Evidence, recorded: Evidence) -> Evidence:
    """Let the base err in a planned motion as in the recorded one that it is made from, at the same share of it."""
    now = np.abs(planned.phase[:, None] - recorded.phase).argmin(1)
    return replace(planned, residual=planned.seen[..., None] * recorded.residual[now], spread_m=recorded.spread_m[now])
