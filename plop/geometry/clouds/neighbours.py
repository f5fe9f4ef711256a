"""Nearest neighbours of points."""

from __future__ import annotations

import torch
from scipy.spatial import cKDTree
from torch import Tensor


def nearest(points: Tensor, count: int, *, queries: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Find the nearest points of each query.

    Args:
        points: Shape [N, 3] [m].
        count: Neighbours per query; at most N - 1 (N with separate queries) are returned.
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


def nearest_index(points: Tensor, among: Tensor) -> Tensor:
    """Find the nearest of some positions for every point; no gradient.

    Args:
        points: Shape [M, 3], m.
        among: Shape [N, 3] with N >= 1, m.

    Returns:
        Rows of `among`, shape [M], int64.
    """
    tree = cKDTree(among.detach().cpu().numpy())
    index = tree.query(points.detach().cpu().numpy())[1]
    return torch.as_tensor(index, dtype=torch.int64, device=points.device)


def nearest_distance(points: Tensor) -> Tensor:
    """Measure the distance from each point to its nearest neighbour in the same set, [N, D] -> [N] in their unit.

    Infinite for a single point; no gradient.
    """
    array = points.detach().cpu().numpy()
    distance = cKDTree(array).query(array, k=2)[0][:, 1]
    return torch.as_tensor(distance, dtype=points.dtype, device=points.device)
