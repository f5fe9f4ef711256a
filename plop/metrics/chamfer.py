"""Chamfer distance between two point clouds, in millimetres.

Convention: for each point the distance to the nearest point of the other cloud, averaged
over each cloud; then the mean of the two directions. `cd_mm` uses the distance itself,
`cd_sq_mm2` its square. The literature also uses sums of both directions (twice these values).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

MM_PER_M = 1000.0


@dataclass(frozen=True)
class NearestDistances:
    """Distance of every point to the other cloud, both ways [m]."""

    from_a: np.ndarray
    """Shape [A]."""
    from_b: np.ndarray
    """Shape [B]."""


def nearest_distances(points_a: np.ndarray, points_b: np.ndarray) -> NearestDistances | None:
    """Find for every point the distance to the nearest point of the other cloud.

    Args:
        points_a: Shape [A, 3], metres.
        points_b: Shape [B, 3], metres.

    Returns:
        Distances in metres, or None when a cloud is empty.
    """
    if len(points_a) == 0 or len(points_b) == 0:
        return None
    return NearestDistances(cKDTree(points_b).query(points_a)[0], cKDTree(points_a).query(points_b)[0])


def cd_mm(distances: NearestDistances | None) -> float | None:
    """Average the nearest distances, mean of both directions, not squared [mm]; None when undefined."""
    if distances is None:
        return None
    return float(0.5 * (distances.from_a.mean() + distances.from_b.mean()) * MM_PER_M)


def cd_sq_mm2(distances: NearestDistances | None) -> float | None:
    """Average the squared nearest distances, mean of both directions [mm^2]; None when undefined."""
    if distances is None:
        return None
    return float(0.5 * ((distances.from_a**2).mean() + (distances.from_b**2).mean()) * MM_PER_M**2)
