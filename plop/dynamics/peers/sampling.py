"""Farthest point sampling: a few points that cover a cloud evenly (Eldar et al., 1997)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from plop.compute.cpu_kernels import array_of, kernel


@kernel
def _farthest(points: np.ndarray, chosen: np.ndarray) -> None:
    """Fill `chosen` with indices, each that of the point farthest from those before it."""
    nearest = np.full(len(points), np.inf)
    middle = np.zeros(3)
    for i in range(len(points)):
        for c in range(3):
            middle[c] += points[i, c] / len(points)
    last = middle
    for k in range(len(chosen)):
        best, far = 0, -1.0
        for i in range(len(points)):
            d = 0.0
            for c in range(3):
                d += (points[i, c] - last[c]) ** 2
            # the first point is the farthest from the middle, which is not one of the chosen
            nearest[i] = min(nearest[i], d) if k != 1 else d
            if nearest[i] > far:
                best, far = i, nearest[i]
        chosen[k] = best
        last = points[best]


def farthest_points(points: Tensor, count: int) -> Tensor:
    """Choose points that cover a cloud.

    The choice depends on the positions alone, not on their order (but for points at equal distance), so that a model
    that samples stays a function of the state.

    Args:
        points: Shape [N, 3].
        count: Points to choose; 0, or N and more, chooses all in their order.

    Returns:
        Indices, shape [min(count, N)], int64, without gradient.
    """
    if count == 0 or count >= len(points):
        return torch.arange(len(points), device=points.device)
    chosen = np.empty(count, np.int64)
    _farthest(array_of(points.cpu().double()), chosen)
    return torch.from_numpy(chosen).to(points.device)
