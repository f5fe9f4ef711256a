"""A grid that follows the object: its box, padded to the stride of the network.

Grids whose nodes lie at whole multiples of the spacing in the frame of the tool see the tool always
at the same place in a cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class GridBox:
    """Where the nodes of a batch of grids lie."""

    origin: Tensor
    """Position of node (0, 0, 0) of each grid, shape [B, 3] [m]."""
    spacing_m: float
    shape: tuple[int, int, int]
    """Nodes along x, y, z: the same for the whole batch, multiples of the stride."""

    @property
    def size(self) -> int:
        """Nodes of one grid."""
        return self.shape[0] * self.shape[1] * self.shape[2]


def fit_grid(positions: Tensor, counts: Sequence[int], spacing_m: float, *, stride: int, room: int = 2) -> GridBox:
    """Lay one grid around the particles of each batch entry.

    Args:
        positions: Particles of all entries, one entry after the other, shape [N, 3] [m].
        counts: Particles of each of the B entries.
        spacing_m: Distance of two nodes [m].
        stride: The shape is padded to a multiple of this.
        room: Cells kept free around the particles.

    Returns:
        Grids of a common shape, origins at whole multiples of the spacing.
    """
    pieces = positions.detach().split(list(counts))
    low = (torch.stack([piece.amin(0) for piece in pieces]) / spacing_m).floor() - room
    high = (torch.stack([piece.amax(0) for piece in pieces]) / spacing_m).floor() + room + 1
    extent = (high - low).amax(0) + 1
    padded = [int(-(-int(n) // stride) * stride) for n in extent]
    return GridBox(low * spacing_m, spacing_m, (padded[0], padded[1], padded[2]))
