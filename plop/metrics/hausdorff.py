"""Hausdorff distance between two point clouds, in millimetres.

Convention: the largest nearest distance of either direction (symmetric, the maximum itself
and not a percentile); one stray point decides it.
"""

from __future__ import annotations

from plop.metrics.chamfer import MM_PER_M, NearestDistances


def hd_mm(distances: NearestDistances | None) -> float | None:
    """Take the largest nearest distance of both directions [mm]; None when a cloud is empty."""
    if distances is None:
        return None
    return float(max(distances.from_a.max(), distances.from_b.max()) * MM_PER_M)
