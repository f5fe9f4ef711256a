"""Planes through the surroundings of pixels of a depth image: the surface without the noise of single pixels."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from plop.geometry.cameras import Camera

NORMAL_ERROR = 0.15
"""Windows are as small as noise allows: the error of a normal [rad] that they leave."""
MOST_HALF = 20
"""Largest half width of a window [px]."""
PLANES_ACROSS = 320
"""About so many planes are fitted across a larger image, unless windows are so small that they would leave gaps."""
MEASURED_SHARE = 0.6
"""Share of a window's pixels that must be measured."""
NOISES = 4.0
"""Residual of a flat window in units of the camera's noise; an edge leaves more ..."""
BEND = 0.1
"""... and more than this share of half a window, by which a smooth object bends."""


@dataclass(frozen=True)
class LocalPlanes:
    """Planes m . X = 1, m and X in the camera's axes, on a grid of pixels."""

    vectors: np.ndarray
    """m, shape [rows, columns, 3] [1/m], away from the camera; NaN where no flat surface was measured."""
    step: int
    """Pixels from one plane to the next."""
    window_px: int
    """Width of a window [px]."""

    def at(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Give the planes next to pixels, shape [N, 3]."""
        last = np.array(self.vectors.shape[:2])[:, None] - 1
        row, column = np.minimum(np.stack([rows, columns]) // self.step, last)
        return np.asarray(self.vectors[row, column])


def local_planes(camera: Camera, depth_m: np.ndarray, region: np.ndarray) -> LocalPlanes:
    """Fit planes to windows of a depth image; windows with an edge, a crease or holes give none.

    The image of a plane is linear in 1 / depth, so that least squares are sums over windows. The noise of the camera
    is what the flattest quarter of windows leaves: in coarse images most of the others hold edges.

    Args:
        camera: It took the image.
        depth_m: Shape [H, W], metres, 0 or NaN = not measured.
        region: Bool, shape [H, W]: where noise and distance are taken from.
    """
    measured = np.isfinite(depth_m) & (depth_m > 0)
    if not (measured & region).any():
        return LocalPlanes(np.full((1, 1, 3), np.nan), max(depth_m.shape), 1)
    pixel_m = float(np.median(depth_m[measured & region])) / camera.intrinsics[0, 0]
    coarse = -(-max(depth_m.shape) // PLANES_ACROSS)
    half = _half_window(_noise_m(_fitted(depth_m, measured, 1, coarse)[1], region[::coarse, ::coarse]) / pixel_m)
    step = min(half, coarse)
    fit, residual_m = _fitted(depth_m, measured, half, step)
    noise_m = _noise_m(residual_m, region[::step, ::step])
    fit[~(residual_m < np.hypot(NOISES * noise_m, BEND * half * pixel_m))] = np.nan
    y, x = np.mgrid[0 : depth_m.shape[0] : step, 0 : depth_m.shape[1] : step] + 0.5
    fit[..., 2] -= fit[..., 0] * x + fit[..., 1] * y
    return LocalPlanes(fit @ camera.intrinsics, step, 2 * half + 1)


def _half_window(noise_px: float) -> int:
    """Give half the width of the smallest window [px] whose normals are exact enough for noise in pixel widths."""
    halves = np.arange(1, MOST_HALF + 1)
    errors = noise_px / ((2 * halves + 1) * np.sqrt(halves * (halves + 1) / 3))
    return int(min((errors > NORMAL_ERROR).sum() + 1, MOST_HALF))


def _noise_m(residual_m: np.ndarray, region: np.ndarray) -> float:
    seen = residual_m[region & np.isfinite(residual_m)]
    return float(np.quantile(seen, 0.25)) if len(seen) else 0.0


def _fitted(depth_m: np.ndarray, measured: np.ndarray, half: int, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Fit 1 / depth = a . (x, y, 1) about the middle of each window: a, [h, w, 3], and what it leaves [m], [h, w]."""
    normal, right, square = _window_sums(depth_m, measured, half, step)
    count = normal[..., 2, 2]
    use = measured[::step, ::step] & (count >= MEASURED_SHARE * (2 * half + 1) ** 2)
    fit = np.full(right.shape, np.nan)
    fit[use] = np.linalg.solve(normal[use], right[use][..., None])[..., 0]
    left = np.maximum(square - (fit * right).sum(-1), 0) / np.maximum(count - 3, 1)
    return fit, np.sqrt(left) / fit[..., 2] ** 2


def _window_sums(
    depth_m: np.ndarray, measured: np.ndarray, half: int, step: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sum a a^T, a / depth and 1 / depth^2 over windows, a = (x, y, 1) from the middle of each window."""
    height, width = depth_m.shape
    y, x = np.mgrid[0:height, 0:width] - np.array([height, width])[:, None, None] / 2
    basis = np.stack([x, y, np.ones_like(x)]) * measured
    inverse = np.divide(1.0, depth_m, out=np.zeros((height, width)), where=measured)

    def total(image: np.ndarray) -> np.ndarray:
        size = (2 * half + 1, 2 * half + 1)
        found = cv2.boxFilter(image, cv2.CV_64F, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(found[::step, ::step])

    normal = np.stack([np.stack([total(a * b) for a in basis], -1) for b in basis], -2)
    right = np.stack([total(a * inverse) for a in basis], -1)
    shift = np.zeros(normal.shape) + np.eye(3)
    shift[..., 0, 2], shift[..., 1, 2] = -x[::step, ::step], -y[::step, ::step]
    return shift @ normal @ shift.swapaxes(-1, -2), (shift @ right[..., None])[..., 0], total(inverse * inverse)
