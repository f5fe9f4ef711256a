"""World points of a depth image, and the height of the table."""

from __future__ import annotations

import numpy as np

from plop.geometry.cameras import Camera
from plop.geometry.rigid import transform_points


def world_points(camera: Camera, depth_m: np.ndarray) -> np.ndarray:
    """World point of every pixel, shape [H, W, 3] [m]; the camera's centre where depth is not measured."""
    return transform_points(camera.world_from_cam, camera.pixel_directions() * np.nan_to_num(depth_m)[..., None])


def estimate_table_z(points: np.ndarray, workspace: np.ndarray, *, bin_m: float = 0.004) -> float | None:
    """Find the height at which most points of the workspace lie; None when there are too few.

    Args:
        points: World points, shape [N, 3] [m].
        workspace: Lowest and highest corner, shape [2, 3]; only x and y are used.
        bin_m: Resolution [m].
    """
    inside = (points[:, :2] >= workspace[0, :2]).all(1) & (points[:, :2] <= workspace[1, :2]).all(1)
    heights = points[inside, 2]
    heights = heights[np.abs(heights) < 1.0]
    if len(heights) < 50:
        return None
    counts, edges = np.histogram(heights, bins=np.arange(-1.0, 1.0 + bin_m, bin_m))
    peak = edges[int(np.argmax(np.convolve(counts, [1, 2, 1], mode="same")))] + bin_m / 2
    return float(np.median(heights[np.abs(heights - peak) < 1.5 * bin_m]))
