"""Is the tool where the scene is? Poses in millimetres put it far outside."""

from __future__ import annotations

import numpy as np

from plop.errors import PlopError
from plop.geometry.rigid import transform_points

FAR = 20.0
"""Sizes of the scene or of the tool, whichever is larger, beyond which a tool cannot be meant."""
LEAST_FAR_M = 1.0
"""A tool nearer than this is believed, however small the scene [m]."""


def check_tool_reach(tool_vertices: np.ndarray, world_from_tool: np.ndarray, scene: np.ndarray, where: str) -> None:
    """Refuse a tool that at all frames is tens of times the scene's size away; one that only never touches passes.

    Args:
        tool_vertices: Shape [V, 3], in the tool's frame [m].
        world_from_tool: Pose of the tool at every frame, shape [T, 4, 4].
        scene: Points of what the tool works on or is seen from, shape [N, 3], world [m].
        where: File and key of the poses, for the message.

    Raises:
        PlopError: The tool is too far away; the message names the unit.
    """
    low, high = scene.min(0), scene.max(0)
    size = max(float((high - low).max()), float(np.ptp(tool_vertices, axis=0).max()))
    points = np.stack([transform_points(pose, tool_vertices) for pose in world_from_tool])
    outside = np.maximum(np.maximum(low - points, points - high), 0)
    nearest = float(np.linalg.norm(outside, axis=-1).min())
    farthest = max(FAR * size, LEAST_FAR_M)
    if nearest > farthest:
        raise PlopError(
            "The tool is far from everything else at all frames.",
            where=where,
            expected=f"metres: a tool within {farthest:.3g} m of a scene of {size:.3g} m",
            found=f"{nearest:.4g} m away at its nearest",
            fix="Translations in millimetres? Divide them by 1000, or correct the frame.",
        )
