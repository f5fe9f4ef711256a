"""Find a dominant plane (a table) in a point cloud by random sampling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.errors import PlopError


@dataclass(frozen=True)
class Plane:
    """All points with normal . x = offset."""

    normal: np.ndarray
    """Unit length, shape [3]; upward (z >= 0)."""
    offset_m: float
    """[m]"""
    share: float
    """Share of the points that lie on it, 0 to 1."""

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """Height of points above the plane, [N, 3] -> [N] [m]."""
        return np.asarray(points @ self.normal - self.offset_m)


def find_plane(points: np.ndarray, *, threshold_m: float = 0.004, trials: int = 500, seed: int = 0) -> Plane:
    """Find the plane that most points lie on: RANSAC (Fischler and Bolles 1981), then least squares on its inliers.

    Args:
        points: Shape [N, 3], metres.
        threshold_m: Largest distance of an inlier from the plane [m].
        trials: Random triples tried.
        seed: Seed of the random choice.

    Raises:
        PlopError: Fewer than three points, or all on one line.
    """
    if len(points) < 3:
        raise PlopError("There are too few points for a plane.", expected="at least 3 points", found=f"{len(points)}")
    generator = np.random.default_rng(seed)
    sample = points[generator.choice(len(points), min(len(points), 5000), replace=False)]
    triples = sample[generator.integers(0, len(sample), (trials, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    length = np.linalg.norm(normals, axis=1)
    triples, normals = triples[length > 1e-12], normals[length > 1e-12]
    if len(normals) == 0:
        raise PlopError("The points lie on one line and define no plane.", found=f"{len(points)} points")
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = (normals * triples[:, 0]).sum(1)
    counts = [int((np.abs(sample @ n - o) < threshold_m).sum()) for n, o in zip(normals, offsets, strict=True)]
    best = int(np.argmax(counts))
    normal, offset = normals[best], offsets[best]
    for _ in range(3):
        near = points[np.abs(points @ normal - offset) < threshold_m]
        center = near.mean(0)
        normal = np.linalg.svd(near - center, full_matrices=False)[2][2]
        offset = normal @ center
    if normal[2] < 0:
        normal, offset = -normal, -offset
    return Plane(normal, float(offset), float((np.abs(points @ normal - offset) < threshold_m).mean()))
