"""Rays through the pixels of a camera, and the part of its image that shows some points."""

from __future__ import annotations

import numpy as np

from plop.geometry.cameras import Camera


def pixel_rays(camera: Camera, side: int) -> np.ndarray:
    """Return origins and directions, [H, W, side * side, 6], float32; a direction has length 1 along the optical axis.

    The ray parameter t of a hit is then its depth. Directions are spread evenly over each pixel; with an odd `side`
    the one in the middle goes through the pixel's centre.
    """
    offset = (np.arange(side) + 0.5) / side
    axes = (np.arange(camera.height), np.arange(camera.width), offset, offset)
    y, x, sub_y, sub_x = np.meshgrid(*axes, indexing="ij")
    local = camera.directions(x + sub_x, y + sub_y)
    rays = np.empty((camera.height, camera.width, side * side, 6), np.float32)
    rays[..., :3] = camera.world_from_cam[:3, 3]
    rays[..., 3:] = local.reshape(camera.height, camera.width, side * side, 3) @ camera.world_from_cam[:3, :3].T
    return rays


def window(camera: Camera, points: np.ndarray) -> tuple[slice, slice]:
    """Return the rows and columns of the box around projected points [N, 3], a pixel wider; all if one is behind."""
    pixels, depth = camera.project(points)
    if (depth < 1e-3).any():
        return slice(0, camera.height), slice(0, camera.width)
    low = np.clip(np.floor(pixels.min(0)) - 1, 0, [camera.width, camera.height]).astype(int)
    high = np.clip(np.ceil(pixels.max(0)) + 1, 0, [camera.width, camera.height]).astype(int)
    return slice(low[1], high[1]), slice(low[0], high[0])
