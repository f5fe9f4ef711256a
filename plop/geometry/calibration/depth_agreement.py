"""Do calibrated cameras agree? Depth of one camera reprojected into another."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plop.geometry.cameras import Camera

FACING = 0.25
"""Smallest cosine between a surface's normal and the way to a camera that can be said to see it."""


@dataclass(frozen=True)
class DepthView:
    """A camera's depth image and the pixels of it that take part."""

    camera: Camera
    depth_m: np.ndarray
    """[H, W] metres, 0 or NaN = not measured"""
    region: np.ndarray
    """[H, W] bool: pixels sent to other cameras"""

    @cached_property
    def points(self) -> np.ndarray:
        """World points of the region, in row-major order, shape [N, 3] [m]."""
        return self.camera.back_project(self.depth_m, self.region)

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals of these points, towards the camera, from neighbouring pixels; NaN where unknown."""
        use = np.isfinite(self.depth_m) & (self.depth_m > 0)
        grid = np.full((*self.depth_m.shape, 3), np.nan)
        grid[use] = self.camera.back_project(self.depth_m)
        down, right = np.gradient(grid, axis=0), np.gradient(grid, axis=1)
        normals = np.cross(down, right)[use & self.region]
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)


@dataclass(frozen=True)
class Disagreement:
    """What the pixels of one camera look like to another."""

    compared: int
    """Points that land on a measured, smooth part of the other image and are not hidden there."""
    median_mm: float
    """Median of the absolute depth difference; NaN when nothing can be compared."""
    bias_mm: float
    """Median of the signed difference, other minus this."""
    ratio: float
    """Median of other depth / this depth; 1 when units and scales agree."""


def disagreement(source: DepthView, target: DepthView, *, gate_m: float = 0.05) -> Disagreement:
    """Reproject the source's depth into the target and compare along the target's optical axis.

    The target's depth is interpolated between its four nearest pixels, where they are all measured and
    within `gate_m` of each other. Only surfaces that face both cameras are compared. A point further than the
    gate behind the measured surface is hidden, one further than that in front of it contradicts the target,
    but so do silhouettes: both are left out of the median. So a median near the gate means that nothing matches.

    Args:
        source: Its region is reprojected.
        target: Is looked up.
        gate_m: Largest difference that can be a difference of calibration [m].

    Returns:
        Counts and medians, millimetres.
    """
    points = source.points
    toward = target.camera.world_from_cam[:3, 3] - points
    facing = (source.normals * toward).sum(1) > FACING * np.linalg.norm(toward, axis=1)
    points = points[facing]
    pixels, expected = target.camera.project(points)
    measured = interpolate_depth(target.depth_m, pixels, gate_m)
    seen = (expected > 0) & np.isfinite(measured)
    ratio = float(np.median(measured[seen] / expected[seen])) if seen.any() else float("nan")
    difference = (measured - expected)[seen]
    difference = difference[np.abs(difference) < gate_m]
    if len(difference) == 0:
        return Disagreement(0, float("nan"), float("nan"), ratio)
    return Disagreement(
        len(difference), float(np.median(np.abs(difference)) * 1e3), float(np.median(difference) * 1e3), ratio
    )


def interpolate_depth(depth_m: np.ndarray, pixels: np.ndarray, gate_m: float) -> np.ndarray:
    """Interpolate a depth image bilinearly, without bridging holes or edges.

    Args:
        depth_m: Shape [H, W], metres, 0 or NaN = not measured.
        pixels: Image coordinates, shape [N, 2]; pixel centres lie at half-integers.
        gate_m: Largest spread of the four neighbours [m].

    Returns:
        Depths, shape [N], metres; NaN where unknown.
    """
    height, width = depth_m.shape
    x, y = pixels[:, 0] - 0.5, pixels[:, 1] - 0.5
    inside = (x >= 0) & (y >= 0) & (x < width - 1) & (y < height - 1)
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    column, row = x.astype(int), y.astype(int)
    corners = np.stack(
        [depth_m[row, column], depth_m[row, column + 1], depth_m[row + 1, column], depth_m[row + 1, column + 1]]
    ).astype(np.float64)
    a, b = x - column, y - row
    value = (corners * np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b])).sum(0)
    good = inside & np.isfinite(corners).all(0) & (corners > 0).all(0) & (np.ptp(corners, axis=0) < gate_m)
    return np.where(good, value, np.nan)


def object_box(clouds: list[np.ndarray], margin_m: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Give the box around the object that the cameras agree on best.

    Args:
        clouds: Object points of each camera, shapes [N, 3], metres.
        margin_m: Added on every side [m].

    Returns:
        Lower and upper corner, each the median over the cameras; None when no camera sees the object.
    """
    seen = [points for points in clouds if len(points)]
    if not seen:
        return None
    low = np.median([np.percentile(points, 2, axis=0) for points in seen], axis=0)
    high = np.median([np.percentile(points, 98, axis=0) for points in seen], axis=0)
    return low - margin_m, high + margin_m


def pixels_in_box(camera: Camera, depth_m: np.ndarray, box: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Find the measured pixels whose points lie in a box, bool, shape [H, W]."""
    use = np.isfinite(depth_m) & (depth_m > 0)
    points = camera.back_project(depth_m)
    inside = ((points >= box[0]) & (points <= box[1])).all(1)
    region = np.zeros(depth_m.shape, dtype=bool)
    region[use] = inside
    return region
