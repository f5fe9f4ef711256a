"""Nearest neighbours of points."""

from __future__ import annotations

import torch
from scipy.spatial import cKDTree
from torch import Tensor


def nearest(points: Tensor, count: int, *, queries: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Find the nearest points of each query.

    Args:
        points: Shape [N, 3] [m].
        count: Neighbours a query; at most N - 1 (N with separate queries) are given.
        queries: Shape [M, 3]; the points themselves when absent, and then a point is not its own neighbour.

    Returns:
        Distances, shape [M, k] [m], and indices, shape [M, k], nearest first; without gradient.
    """
    data = points.detach().cpu().numpy()
    own = queries is None
    asked = data if queries is None else queries.detach().cpu().numpy()
    wanted = min(count + own, len(data))
    distance, index = cKDTree(data).query(asked, k=list(range(1, wanted + 1)))
    skip = 1 if own else 0
    return (torch.from_numpy(distance[:, skip:]).to(points), torch.from_numpy(index[:, skip:]).to(points.device))
