"""A grid that follows the object: its box, padded to the stride of the network.

In grids whose nodes lie at integer multiples of the spacing in the tool's frame, the tool is always
at the same position in a cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from plop.errors import PlopError

MOST_NODES = 128**3
"""Largest number of nodes of one grid: a single stray particle would otherwise need any amount of memory."""


@dataclass(frozen=True)
class GridBox:
    """Node positions of a batch of grids."""

    origin: Tensor
    """Position of node (0, 0, 0) of each grid, shape [B, 3] [m]."""
    spacing_m: float
    shape: tuple[int, int, int]
    """Nodes along x, y, z: the same for the whole batch, multiples of the stride."""

    @property
    def size(self) -> int:
        """Nodes of one grid."""
        return self.shape[0] * self.shape[1] * self.shape[2]


def fit_grid(
    positions: Tensor, batch: Tensor, batches: int, spacing_m: float, *, stride: int, room: int = 2
) -> GridBox:
    """Lay one grid around the particles of each batch entry.

    Args:
        positions: Particles, shape [N, 3] [m].
        batch: Entry of each particle, shape [N], int64.
        batches: Number of entries B.
        spacing_m: Distance of two nodes [m].
        stride: The shape is padded to a multiple of this.
        room: Cells kept free around the particles.

    Returns:
        Grids of a common shape, origins at integer multiples of the spacing.

    Raises:
        PlopError: The particles need more than `MOST_NODES` nodes, or a position is not finite.
    """
    least, most = _bounds(positions.detach(), batch, batches)
    low = (least / spacing_m).floor() - room
    high = (most / spacing_m).floor() + room + 1
    extent = (high - low).amax(0) + 1
    cells = extent.tolist()
    if not math.prod(cells) <= MOST_NODES:  # also where one is not a number
        raise PlopError(
            "The particles have flown apart.",
            where="grid around the particles",
            expected=f"at most {MOST_NODES} nodes {spacing_m:.3g} m apart",
            found=" x ".join(f"{n:.0f}" for n in cells),
            fix="The model diverged: train longer, or with a smaller learning rate.",
        )
    padded = [-(-int(n) // stride) * stride for n in cells]
    return GridBox(low * spacing_m, spacing_m, (padded[0], padded[1], padded[2]))


def _bounds(positions: Tensor, batch: Tensor, batches: int) -> tuple[Tensor, Tensor]:
    """Return the least and the largest coordinates of each batch entry, [B, 3] each."""
    if batches == 1:  # a single entry, as in a rollout: a tenth of the time
        least, most = positions.aminmax(dim=0, keepdim=True)
        return least, most
    least = positions.new_full((batches, 3), torch.inf)
    index = batch[:, None].expand(-1, 3)
    return (least.scatter_reduce(0, index, positions, "amin"), (-least).scatter_reduce(0, index, positions, "amax"))
