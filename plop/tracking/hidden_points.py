"""Tracked points that are hidden by the tool, where tracks are extrapolated."""

from __future__ import annotations

import numpy as np

from plop.physics.engine.tool_motion import ToolKind, ToolMotion, ToolShape

_SOLID_M = 0.006
"""Points closer to a thick tool than this are under it or in its corner [m]."""
_BLADE_M = 0.003
"""The same for a blade, whose sides stay visible [m]."""


def seen_points(tool: ToolMotion, points: np.ndarray) -> np.ndarray:
    """Return which points are not hidden by the tool.

    Args:
        tool: The tool with one pose per frame.
        points: Positions, [T, M, 3] [m].

    Returns:
        Shape [T, M] bool. A point that was hidden stays masked for the rest of the episode: where a tracker finds it
        again depends on its extrapolation in between.
    """
    distance = np.stack([tool_distance(tool, frame, place) for frame, place in enumerate(points)])
    shape = tool.shape
    near = distance < (_BLADE_M if shape.kind == ToolKind.BLADE else _SOLID_M)
    return ~np.logical_or.accumulate(near, axis=0)


def tool_distance(tool: ToolMotion, frame: int, points: np.ndarray) -> np.ndarray:
    """Distance of points to the convex hull of the tool at one frame, approximate outside, negative inside, [M] [m]."""
    shape = ToolShape.from_mesh(tool.vertices, tool.faces, ToolKind.SOLID)
    pose = tool.world_from_tool[frame]
    local = ((points - pose[:3, 3]) @ pose[:3, :3] - shape.center) @ shape.axes
    return np.asarray((local @ shape.faces[:, :3].T - shape.faces[:, 3]).max(1))
