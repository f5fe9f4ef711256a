"""Where the Gaussians of the first frame are in a later state, through split and merge."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from plop.gaussians.state import Gaussians


def follow_gaussians(first: Gaussians, now: Gaussians, points: np.ndarray) -> np.ndarray:
    """Move points with the Gaussians that surrounded them at the first frame.

    Args:
        first: Gaussians at the first frame; their lineage ids are unique.
        now: A later state that descends from them.
        points: Places at the first frame, [M, 3] [m].

    Returns:
        Places now, [M, 3] [m]: each point moves with the mean of its four nearest Gaussians that still exist.
    """
    place = now.means.detach().cpu().numpy().astype(float)
    return np.asarray(points + average_around(first, now, place, points, since=True))


def average_around(
    first: Gaussians, now: Gaussians, values: np.ndarray, points: np.ndarray, *, since: bool = False
) -> np.ndarray:
    """Average values of the Gaussians that surrounded points at the first frame.

    Args:
        first: Gaussians at the first frame; their lineage ids are unique.
        now: A later state that descends from them.
        values: Of its N Gaussians, [N, C].
        points: Places at the first frame, [M, 3] [m].
        since: The values are places, and their change since the first frame is averaged.

    Returns:
        Shape [M, C]: over the four nearest Gaussians that still exist, each the mean of its descendants.
    """
    start, ids = first.means.detach().cpu().numpy().astype(float), now.ids.cpu().numpy()
    row_of = {int(k): row for row, k in enumerate(first.ids.cpu().numpy())}
    rows = np.array([row_of.get(int(k), -1) for k in ids])
    alive, inverse = np.unique(rows[rows >= 0], return_inverse=True)
    number = np.bincount(inverse)
    columns = values[rows >= 0].T
    means = np.stack([np.bincount(inverse, column) / number for column in columns], 1)
    changes = means - start[alive] if since else means
    distance, nearest = cKDTree(start[alive]).query(points, k=min(4, len(alive)))
    distance, nearest = distance.reshape(len(points), -1), nearest.reshape(len(points), -1)
    weight = 1 / (distance + 1e-4)
    return np.asarray((weight[..., None] * changes[nearest]).sum(1) / weight.sum(1)[:, None])
