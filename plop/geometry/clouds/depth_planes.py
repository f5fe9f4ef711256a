"""Planes through the pixels of a depth image, which preserve creases instead of smoothing them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from plop.geometry.cameras import Camera
from plop.geometry.rigid import transform_points

_REACH = 1
"""Radius of a window in pixels: 3 x 3."""
_LEAST = 4.5 / 9
"""Share of a window's pixels that must be measured."""
_LINE = 0.02
"""Second extent of a window over its first, squared, below which its points lie on a line."""


@dataclass(frozen=True)
class PixelPlanes:
    """The surface at each pixel of an image."""

    points: np.ndarray
    """World, where the ray through the pixel's middle meets its plane, [H, W, 3] [m]."""
    normals: np.ndarray
    """Unit, towards the camera, [H, W, 3]."""
    facing: np.ndarray
    """Cosine between normal and direction to the camera, [H, W]; 0 where there is no plane."""


def pixel_planes(camera: Camera, depth_m: np.ndarray, mask: np.ndarray) -> PixelPlanes:
    """Fit a plane to the flattest of the nine 3 x 3 windows that hold a pixel.

    A window across a crease or a step is thick, so that planes stay on their pixel's side of it, as in an
    edge-preserving filter (Kuwahara 1976); over a flat part noise is averaged.

    Args:
        camera: Of the image.
        depth_m: Depth along the optical axis, [H, W] [m]; 0 or NaN is not measured.
        mask: Pixels to use, bool [H, W].
    """
    use = np.isfinite(depth_m) & (depth_m > 0) & mask
    rays = camera.pixel_directions()
    local = np.where(use[..., None], rays * np.where(use, depth_m, 0)[..., None], 0.0)
    middle, normal, thickness = _windows(local, use)
    best = np.full(use.shape, np.inf)
    found = [np.zeros_like(local), np.zeros_like(local)]
    for down in range(-_REACH, _REACH + 1):
        for right in range(-_REACH, _REACH + 1):
            moved = [_shifted(values, down, right) for values in (thickness, middle, normal)]
            better = use & (moved[0] < best)
            best = np.where(better, moved[0], best)
            found = [np.where(better[..., None], new, old) for new, old in zip(moved[1:], found, strict=True)]
    along = (found[1] * rays).sum(-1)
    depth = (found[0] * found[1]).sum(-1) / np.where(np.abs(along) < 1e-9, 1, along)
    points = rays * depth[..., None]
    facing = np.abs(along) / np.linalg.norm(rays, axis=-1)
    # the window may belong to an adjacent surface
    own = np.abs(depth - np.where(use, depth_m, 0)) < 2 * _pixel_m(camera, depth) / np.maximum(facing, 0.1)
    valid = use & np.isfinite(best) & own
    normals = found[1] * -np.sign(along)[..., None]
    world = transform_points(camera.world_from_cam, points.reshape(-1, 3)).reshape(points.shape)
    return PixelPlanes(world, normals @ camera.world_from_cam[:3, :3].T, np.where(valid, facing, 0.0))


def _pixel_m(camera: Camera, depth_m: np.ndarray) -> np.ndarray:
    """Width of a pixel at some depth [m]."""
    return np.asarray(np.abs(depth_m) / camera.intrinsics[0, 0])


def _windows(points: np.ndarray, use: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle [H, W, 3], normal [H, W, 3] and variance across [H, W] of the window around each pixel.

    The variance is infinite where too few points are measured or all lie on a line.
    """
    origin = points[use].mean(0) if use.any() else np.zeros(3)
    centred = np.where(use[..., None], points - origin, 0.0)
    size = 2 * _REACH + 1

    def mean(values: np.ndarray) -> np.ndarray:
        return np.asarray(uniform_filter(values, size=(size, size, *[1] * (values.ndim - 2)), mode="constant"))

    share = mean(use.astype(np.float64))
    some = np.maximum(share, 1e-9)
    middle = mean(centred) / some[..., None]
    products = mean(centred[..., :, None] * centred[..., None, :]) / some[..., None, None]
    covariance = products - middle[..., :, None] * middle[..., None, :]
    thickness = np.full(use.shape, np.inf)
    normal = np.zeros_like(points)
    rows = share > _LEAST
    extent, axes = np.linalg.eigh(covariance[rows])
    thickness[rows] = np.where(extent[:, 1] > _LINE * extent[:, 2], np.maximum(extent[:, 0], 0), np.inf)
    normal[rows] = axes[..., 0]
    return middle + origin, normal, thickness


def _shifted(values: np.ndarray, down: int, right: int) -> np.ndarray:
    """Shift an image: each pixel gets the value of one below and to the right; infinity (or 0) beyond the edge."""
    filled = np.full_like(values, np.inf if values.ndim == 2 else 0)
    height, width = values.shape[:2]
    to = (slice(max(-down, 0), height - max(down, 0)), slice(max(-right, 0), width - max(right, 0)))
    source = (slice(max(down, 0), height - max(-down, 0)), slice(max(right, 0), width - max(-right, 0)))
    filled[to] = values[source]
    return filled
