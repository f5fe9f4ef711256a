"""Do calibrated cameras agree? Surfaces that one camera measured, held against those of another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import t as student

from plop.geometry.calibration.local_planes import LocalPlanes, local_planes
from plop.geometry.cameras import Camera
from plop.geometry.rigid import transform_points

FACING = 0.25
"""Smallest cosine between a surface's normal and the way to a camera that can be said to see it."""
SAME_SURFACE = 0.8
"""Smallest cosine between normals of one surface in two cameras; noise and 8 mm of a bent object turn them by less."""
PIECE_WINDOWS = 2
"""Width of a piece in windows of the coarser camera: noise, holes and frayed outlines of neighbours are independent."""
MUTUAL = 0.5
"""Share of a distance by which it may differ when the other camera looks back: one motion makes both alike."""
CHANCE = 1e-3
"""Chance that a right pair of cameras seems to disagree."""


@dataclass(frozen=True)
class DepthView:
    """A camera's depth image and the pixels of it that take part."""

    camera: Camera
    depth_m: np.ndarray
    """[H, W] metres, 0 or NaN = not measured"""
    region: np.ndarray
    """[H, W] bool: pixels sent to other cameras"""
    focus: np.ndarray
    """[H, W] bool: the object; what moves along the table shows here only"""

    @cached_property
    def planes(self) -> LocalPlanes:
        """Its surface, see `local_planes`."""
        return local_planes(self.camera, self.depth_m, self.region)

    @cached_property
    def surface(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points of the region on these planes [m], unit normals away from the camera, and which are in focus."""
        step, vectors = self.planes.step, self.planes.vectors
        grid = self.region[::step, ::step]
        rows, columns = np.nonzero(grid & np.isfinite(vectors[: grid.shape[0], : grid.shape[1], 0]))
        m, rays = vectors[rows, columns], self.camera.directions(columns * step + 0.5, rows * step + 0.5)
        pose = self.camera.world_from_cam
        points = transform_points(pose, rays / (m * rays).sum(1, keepdims=True))
        normals = m @ pose[:3, :3].T / np.linalg.norm(m, axis=1, keepdims=True)
        return points, normals, self.focus[::step, ::step][rows, columns]


@dataclass(frozen=True)
class Disagreement:
    """How far two cameras are from seeing the same surface."""

    compared: int
    """Points of either that lie on a smooth part of the other's surface and are not hidden there."""
    difference_mm: float
    """Depth difference, root mean square over all points or those in focus, whichever is surer, that one rigid motion
    takes away; what it leaves is noise, outlines and surfaces that only one camera sees. NaN: nothing to compare."""
    resolution_mm: float
    """Chance alone gives less than this."""
    bias_mm: float
    """Median of the signed depth difference, second minus first."""
    ratio: float
    """Median of the second's depth / the first's; 1 when units and scales agree."""

    @property
    def shown_mm(self) -> float:
        """The difference over what chance gives, squares subtracted [mm]."""
        return float(np.sqrt(max(self.difference_mm**2 - self.resolution_mm**2, 0.0)))


@dataclass(frozen=True)
class _Matches:
    """Points of one camera beside planes of another."""

    points: np.ndarray
    """[N, 3] [m]"""
    normals: np.ndarray
    """Of the planes, [N, 3]"""
    distances: np.ndarray
    """From point to plane along the normal, [N] [m]"""
    slants: np.ndarray
    """Depth difference / distance, [N]"""
    ratios: np.ndarray
    """Depth of the plane / depth of the point, [N]; without regard to how far they are apart"""
    focus: np.ndarray
    """[N] bool"""
    piece_m: float


def disagreement(frames: Sequence[tuple[DepthView, DepthView]], *, gate_m: float = 0.05) -> Disagreement:
    """Find how much of the differences between two cameras' surfaces a motion of one of them would take away.

    Points of either are projected into the other, and their distances from its plane there are fitted by a small rigid
    motion (point to plane, Huber). A point that is hidden by another surface is left out: the first camera sees that
    surface where it is, so that the way back gives another distance (left-right check). Noise and frayed outlines do
    not fit one motion: the surface is cut into pieces, and the motion is found again without each of them (jackknife),
    which corrects the bias of the difference and gives its standard error, whatever the errors of the pieces are.

    Args:
        frames: The two cameras at one or more instants.
        gate_m: Largest distance that can be a difference of calibration [m].

    Returns:
        Millimetres. Nothing is compared where chance alone could give differences up to the gate.

    Source: point to plane, Chen and Medioni, Image and Vision Computing 10, 1992; left-right check, Fua, Machine Vision
    and Applications 6, 1993; jackknife, Efron and Stein, Annals of Statistics 9, 1981.
    """
    there = [_matches(a, b, gate_m) for a, b in frames]
    back = [_matches(b, a, gate_m) for a, b in frames]
    ratios = np.concatenate([each.ratios for each in there])
    ratio = float(np.median(ratios)) if len(ratios) else float("nan")
    biases = np.concatenate([each.slants * each.distances for each in there])
    points, normals, slants, focus = (
        np.concatenate([getattr(each, what) for each in there + back])
        for what in ("points", "normals", "slants", "focus")
    )
    distances = np.concatenate([each.distances for each in there] + [-each.distances for each in back])
    pieces = _pieces(points, max(each.piece_m for each in there + back))
    if pieces.max(initial=0) > 0:
        motions = _motions(points, normals, distances, pieces)
        sights = [slants[:, None] * motions.rows, (slants[:, None] * motions.rows)[focus]]
        found = [motions.size(each) for each in sights if len(each)]
        sure = float(student.ppf(1 - CHANCE, pieces.max()))
        difference, error = max(found, key=lambda each: each[0] ** 2 - (sure * each[1]) ** 2)
        if not found[0][0] < sure * found[0][1] or sum(np.array([1, sure]) * found[0]) < gate_m:
            bias = float(np.median(biases)) if len(biases) else float("nan")
            return Disagreement(len(points), 1e3 * difference, 1e3 * sure * error, 1e3 * bias, ratio)
    return Disagreement(0, float("nan"), float("nan"), float("nan"), ratio)


def _matches(source: DepthView, target: DepthView, gate_m: float) -> _Matches:
    points, own_normals, focus = source.surface
    there = _sight(points, target)
    facing = (there.normals * (points - target.camera.world_from_cam[:3, 3])).sum(1) > FACING * there.away_m
    seen = facing & ((there.normals * own_normals).sum(1) > SAME_SURFACE)
    near = seen & (np.abs(there.distances) < gate_m)
    pixel_m = float(np.median(there.depths[near])) / target.camera.intrinsics[0, 0] if near.any() else 0.0
    back = _sight(there.feet[near], source).distances
    # what lies before or behind must do so seen from the other camera, too; else it is hidden by another surface
    mutual = np.abs(there.distances[near] + back) <= np.maximum(MUTUAL * np.abs(there.distances[near]), pixel_m)
    kept = np.flatnonzero(near)[mutual]
    piece_m = PIECE_WINDOWS * target.planes.window_px * pixel_m
    return _Matches(
        points[kept],
        there.normals[kept],
        there.distances[kept],
        there.slants[kept],
        there.ratios[seen],
        focus[kept],
        piece_m,
    )


@dataclass(frozen=True)
class _Sight:
    """Points beside the planes of the surface that a camera measured in their direction, NaN where there is none."""

    normals: np.ndarray
    """[N, 3] in the world"""
    distances: np.ndarray
    """From point to plane along the normal, [N] [m]"""
    feet: np.ndarray
    """Where the plane lies on the camera's ray to the point, [N, 3] [m]"""
    depths: np.ndarray
    """Of the feet, [N] [m]"""
    slants: np.ndarray
    """Depth difference / distance, [N]"""
    ratios: np.ndarray
    """Depth of the plane / depth of the point, [N]"""
    away_m: np.ndarray
    """From camera to point, [N]"""


def _sight(points: np.ndarray, target: DepthView) -> _Sight:
    inside, rows, columns, depth = target.camera.pixels_of(points)
    vectors = np.where(inside[:, None], target.planes.at(rows, columns), np.nan)
    local = transform_points(target.camera.cam_from_world, points)
    length, across = np.linalg.norm(vectors, axis=1), (vectors * local).sum(1)
    pose = target.camera.world_from_cam
    return _Sight(
        (vectors / length[:, None]) @ pose[:3, :3].T,
        (1 - across) / length,
        transform_points(pose, local / across[:, None]),
        depth / across,
        depth * length / across,
        1 / across,
        np.linalg.norm(local, axis=1),
    )


def _pieces(points: np.ndarray, width_m: float) -> np.ndarray:
    """Number the cubes of a grid that points lie in, shape [N]."""
    if not len(points):
        return np.zeros(0, int)
    return np.unique(np.floor(points / width_m), axis=0, return_inverse=True)[1].ravel()


@dataclass(frozen=True)
class _Motions:
    """Small rigid motions that explain distances of points from planes."""

    rows: np.ndarray
    """Distance per motion, [N, 6]"""
    whole: np.ndarray
    """Fitted to all pieces, [6]"""
    others: np.ndarray
    """Fitted without each piece, [G, 6]"""

    def size(self, rows: np.ndarray) -> tuple[float, float]:
        """Give the root mean square of rows [M, 6] times the motion, without bias, and its standard error [m]."""
        square = rows.T @ rows / len(rows)
        whole, parts = (np.einsum("...i,ij,...j", each, square, each) for each in (self.whole, self.others))
        count = len(parts)
        error = np.sqrt((count - 1) * np.sqrt(parts).var())
        return float(np.sqrt(np.clip(count * whole - (count - 1) * parts.mean(), 0, whole))), float(error)


def _motions(points: np.ndarray, normals: np.ndarray, distances: np.ndarray, pieces: np.ndarray) -> _Motions:
    arms = points - points.mean(0)
    rows = np.concatenate([normals, np.cross(arms / np.abs(arms).max(), normals)], 1)
    faint = 1e-6 * len(rows) * np.eye(6)  # what no surface shows stays at rest
    weights, motion = np.ones(len(rows)), np.zeros(6)
    for _ in range(8):
        weighted = rows * weights[:, None]
        motion = np.linalg.solve(weighted.T @ rows + faint, weighted.T @ distances)
        left = np.abs(distances - rows @ motion)
        scale = 1.345 * 1.4826 * np.median(left) + 1e-6  # Huber's, of the median absolute deviation
        weights = scale / np.maximum(left, scale)
    weighted = rows * weights[:, None]
    members = [np.flatnonzero(pieces == piece) for piece in range(pieces.max() + 1)]
    normal = np.stack([weighted[each].T @ rows[each] for each in members])
    right = np.stack([weighted[each].T @ distances[each] for each in members])
    others = np.linalg.solve(normal.sum(0) - normal + faint, (right.sum(0) - right)[..., None])[..., 0]
    return _Motions(rows, motion, others)


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
