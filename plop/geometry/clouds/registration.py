"""Register many overlapping clouds to each other at once (multiway point-to-plane ICP).

No library, since Open3D registers pair by pair before it combines the pairs, has no depth scale per camera, and
changes degrees of freedom that the overlap does not constrain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.geometry.clouds.pointcloud import PointCloud

_NORMALS_AGREE = 0.7
"""Smallest cosine between the normals of corresponding points."""
_TRUSTED_M = 3e-4
"""Residuals below this have full weight: a large flat part that fits exactly must not dominate the rest [m]."""


@dataclass(frozen=True)
class Registration:
    """The correction of each cloud."""

    corrections: np.ndarray
    """One rigid transform per cloud, shape [V, 4, 4]; applied to its points in the world."""
    scales: np.ndarray
    """One factor per cloud for the distance from its camera, shape [V]; ones unless asked for."""
    residual_before_mm: float
    """Median absolute point-to-plane distance of corresponding points [mm]; NaN without overlap."""
    residual_after_mm: float
    """The same after registration [mm]."""
    pairs: int
    """Ordered pairs of clouds that overlap."""
    iterations: int


@dataclass
class _Solver:
    clouds: Sequence[PointCloud]
    rims: list[np.ndarray]
    centers: np.ndarray
    free_pose: bool
    free_scale: bool
    middle: np.ndarray
    fixed: Sequence[int]

    @property
    def width(self) -> int:
        """Unknowns per cloud: rotation about the middle, translation, scale."""
        return 6 * self.free_pose + self.free_scale

    def columns(self, points: np.ndarray, normals: np.ndarray, center: np.ndarray) -> np.ndarray:
        """Derivative of normal . point by the unknowns of the point's cloud, shape [K, width]."""
        parts = []
        if self.free_pose:
            parts += [np.cross(points - self.middle, normals), normals]
        if self.free_scale:
            parts.append(((points - center) * normals).sum(1, keepdims=True))
        return np.concatenate(parts, axis=1)


def register(
    clouds: Sequence[PointCloud],
    *,
    gate_m: float,
    iterations: int = 30,
    free_pose: bool = True,
    centers: np.ndarray | None = None,
    fixed: Sequence[int] = (),
    min_overlap: float = 0.05,
) -> Registration:
    """Minimise point-to-plane distances between all overlapping pairs of clouds jointly.

    Every step solves one damped normal equation for all clouds; damping leaves unconstrained directions
    (the common motion, sliding along a plane) unchanged. Weights are Huber's.
    (Chen and Medioni 1992 for the distance; Pulli 1999 for the joint solution.)

    Args:
        clouds: In the world frame under the present calibration, metres.
        gate_m: Initial largest distance of corresponding points; it decreases to a quarter [m].
        iterations: Largest number of steps.
        free_pose: Whether rotation and translation of each cloud are unknown.
        centers: Camera centres, shape [V, 3], metres: given, a depth scale per cloud is unknown too.
        fixed: Indices of clouds that are not moved.
        min_overlap: Share of a cloud's points that must have a partner for a pair to count.

    Returns:
        Corrections, scales and residuals. Without overlap: identities and NaN.

    Raises:
        PlopError: Nothing is unknown, or a cloud is not finite.
    """
    if not free_pose and centers is None:
        raise PlopError("Registration has nothing to solve for.", expected="free_pose or centers")
    for index, cloud in enumerate(clouds):
        if not np.isfinite(cloud.points).all():
            raise PlopError(
                "A cloud has positions that are not finite.",
                where=f"cloud {index}",
                expected="finite metres",
                found="NaN or infinity",
            )
    count = len(clouds)
    poses, scales = np.tile(np.eye(4), (count, 1, 1)), np.ones(count)
    used = [cloud for cloud in clouds if len(cloud)]
    middle = np.concatenate([c.points for c in used]).mean(0) if used else np.zeros(3)
    middles = np.tile(middle, (count, 1)) if centers is None else centers
    rims = [_rim(cloud.points) for cloud in clouds]
    solver = _Solver(clouds, rims, middles, free_pose, centers is not None, middle, fixed)
    pairs = _overlapping(clouds, gate_m, min_overlap)
    before = residual_mm(clouds, pairs, gate_m)
    if not pairs:
        return Registration(poses, scales, before, before, 0, 0)
    gate, done = gate_m, 0
    while done < iterations:
        done += 1
        current = _applied(solver, poses, scales)
        step = _step(solver, current, poses, pairs, gate)
        moved = _update(solver, step, poses, scales)
        gate = max(0.85 * gate, gate_m / 4)
        if moved < 1e-7 and gate <= gate_m / 4:
            break
    after = residual_mm(_applied(solver, poses, scales), pairs, gate_m)
    return Registration(poses, scales, before, after, len(pairs), done)


def residual_mm(clouds: Sequence[PointCloud], pairs: Sequence[tuple[int, int]], gate_m: float) -> float:
    """Measure the fit: median absolute point-to-plane distance over corresponding points [mm]."""
    trees = [cKDTree(cloud.points) if len(cloud) else None for cloud in clouds]
    found = [_matches(clouds[a], clouds[b], trees[b], gate_m) for a, b in pairs]
    values = [
        np.abs(((clouds[a].points[i] - clouds[b].points[j]) * clouds[b].normals[j]).sum(1))
        for (a, b), (i, j) in zip(pairs, found, strict=True)
    ]
    joined = np.concatenate(values) if values else np.zeros(0)
    return float(np.median(joined) * 1e3) if len(joined) else float("nan")


def _overlapping(clouds: Sequence[PointCloud], gate_m: float, min_overlap: float) -> list[tuple[int, int]]:
    trees = [cKDTree(cloud.points) if len(cloud) else None for cloud in clouds]
    pairs = []
    for a, source in enumerate(clouds):
        for b, target in enumerate(clouds):
            if a == b or len(source) == 0 or len(target) == 0:
                continue
            low, high = target.points.min(0) - gate_m, target.points.max(0) + gate_m
            if not ((source.points >= low) & (source.points <= high)).all(1).any():
                continue
            matched = len(_matches(source, target, trees[b], gate_m)[0])
            if matched >= max(20, min_overlap * len(source)):
                pairs.append((a, b))
    return pairs


def _matches(
    source: PointCloud, target: PointCloud, tree: cKDTree | None, gate_m: float
) -> tuple[np.ndarray, np.ndarray]:
    if tree is None or len(source) == 0:
        return np.zeros(0, int), np.zeros(0, int)
    distance, index = tree.query(source.points, distance_upper_bound=gate_m)
    near = np.flatnonzero(np.isfinite(distance))
    near = near[(source.normals[near] * target.normals[index[near]]).sum(1) > _NORMALS_AGREE]
    return near, index[near]


def _rim(points: np.ndarray, neighbors: int = 12) -> np.ndarray:
    """Find the points at the border of a cloud, bool, shape [N]: points beyond it would be attracted to them."""
    if len(points) <= neighbors:
        return np.zeros(len(points), dtype=bool)
    distance, index = cKDTree(points).query(points, k=neighbors + 1)
    lopsided = np.linalg.norm(points[index[:, 1:]].mean(1) - points, axis=1)
    return np.asarray(lopsided > 0.35 * distance[:, -1])


def _applied(solver: _Solver, poses: np.ndarray, scales: np.ndarray) -> list[PointCloud]:
    out = []
    for cloud, pose, scale, center in zip(solver.clouds, poses, scales, solver.centers, strict=True):
        points = center + scale * (cloud.points - center) if solver.free_scale else cloud.points
        out.append(PointCloud(points, cloud.normals, cloud.colors).moved(pose))
    return out


def _step(
    solver: _Solver, clouds: Sequence[PointCloud], poses: np.ndarray, pairs: Sequence[tuple[int, int]], gate: float
) -> np.ndarray:
    width, total = solver.width, solver.width * len(clouds)
    matrix, right = np.zeros((total, total)), np.zeros(total)
    trees = {b: cKDTree(clouds[b].points) for b in {b for _, b in pairs}}
    centers = np.einsum("vij,vj->vi", poses[:, :3, :3], solver.centers) + poses[:, :3, 3]
    for a, b in pairs:
        i, j = _matches(clouds[a], clouds[b], trees[b], gate)
        inner = ~solver.rims[b][j]
        i, j = i[inner], j[inner]
        if len(i) == 0:
            continue
        p, q, n = clouds[a].points[i], clouds[b].points[j], clouds[b].normals[j]
        error = ((p - q) * n).sum(1)
        limit = max(1.5 * 1.4826 * float(np.median(np.abs(error))), _TRUSTED_M)
        weight = np.minimum(1.0, limit / np.maximum(np.abs(error), 1e-12)) / len(i)
        rows = np.concatenate([solver.columns(p, n, centers[a]), -solver.columns(q, n, centers[b])], axis=1)
        places = np.concatenate([np.arange(a * width, (a + 1) * width), np.arange(b * width, (b + 1) * width)])
        matrix[np.ix_(places, places)] += rows.T @ (weight[:, None] * rows)
        right[places] -= rows.T @ (weight * error)
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-12 * max(np.diag(matrix).max(), 1e-12)))
    scaled = matrix / size / size[:, None] + 1e-4 * np.eye(total)
    for index in solver.fixed:
        own = slice(index * width, (index + 1) * width)
        scaled[own, :], scaled[:, own], right[own] = 0, 0, 0
        scaled[own, own] = np.eye(width)
    return np.asarray(np.linalg.solve(scaled, right / size) / size)


def _update(solver: _Solver, step: np.ndarray, poses: np.ndarray, scales: np.ndarray) -> float:
    parts = step.reshape(len(poses), solver.width)
    if solver.free_scale:
        scales *= 1.0 + np.clip(parts[:, -1], -0.2, 0.2)
    if not solver.free_pose:
        return float(np.abs(parts).max())
    if not solver.fixed:  # The common motion of all clouds is undetermined: keep it at zero.
        parts[:, :6] -= parts[:, :6].mean(0)
    for index, part in enumerate(parts):
        change = np.eye(4)
        change[:3, :3] = Rotation.from_rotvec(part[:3]).as_matrix()
        change[:3, 3] = solver.middle + part[3:6] - change[:3, :3] @ solver.middle
        poses[index] = change @ poses[index]
    return float(np.abs(parts).max())
