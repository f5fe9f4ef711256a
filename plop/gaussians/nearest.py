"""Nearest neighbours among the means of Gaussians."""

from __future__ import annotations

import torch
from scipy.spatial import cKDTree
from torch import Tensor


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
