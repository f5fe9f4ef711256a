"""Interpolation kernels between particles and grid nodes (PLOP, Eq. 18-19).

Three kernels, all normalised so that the weights of one particle sum to 1:

- `paper`: the one printed branch of the cubic, |x| < h, 2 nodes an axis. Its weight at |x| = h
  is 1/6 before normalisation, so features jump when a particle crosses a cell.
- `quadratic`: quadratic B-spline, 3 nodes an axis, smooth.
- `cubic`: full cubic B-spline with both branches, 4 nodes an axis, smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

Kernel = Literal["paper", "quadratic", "cubic"]
NODES_PER_AXIS: dict[str, int] = {"paper": 2, "quadratic": 3, "cubic": 4}


@dataclass(frozen=True)
class Stencil:
    """The cube of n^3 nodes that each particle touches, and how strongly: a product of weights along the axes."""

    offset: Tensor
    """Place in the grid in units of the spacing, shape [N, 3]; differentiable."""
    kernel: Kernel
    shift: Tensor
    """Index of node (0, 0, 0) of the particle's grid, shape [N], int64."""
    shape: tuple[int, int, int]
    """Nodes of a grid along x, y, z; nodes beyond it are clamped to its border."""
    node_count: int
    """Number of nodes of the grid (of all grids of a batch)."""

    def spread(self) -> tuple[Tensor, Tensor]:
        """Write out the nodes and their weights, shape [N, n^3] each; differentiable, on any device."""
        first, along = axis_weights(self.offset, self.kernel)
        steps = torch.arange(along.shape[-1], device=first.device)
        limit = torch.tensor(self.shape, device=first.device)[:, None] - 1
        index = (first[..., None] + steps).clamp_min(0).minimum(limit)
        ix, iy, iz = index[:, 0], index[:, 1], index[:, 2]
        nodes = (ix[:, :, None, None] * self.shape[1] + iy[:, None, :, None]) * self.shape[2] + iz[:, None, None, :]
        wx, wy, wz = along[:, 0], along[:, 1], along[:, 2]
        weights = wx[:, :, None, None] * wy[:, None, :, None] * wz[:, None, None, :]
        return nodes.flatten(1) + self.shift[:, None], weights.flatten(1)


def axis_weights(offset: Tensor, kernel: Kernel) -> tuple[Tensor, Tensor]:
    """Compute the first node and the weights along each axis.

    Args:
        offset: Particle position in units of the spacing, shape [..., 3].
        kernel: Name of the kernel.

    Returns:
        Index of the first node, shape [..., 3], int64; weights, shape [..., 3, n].
    """
    if kernel == "quadratic":
        first = (offset.detach() + 0.5).floor() - 1
        x = offset - first - 1
        weights = [0.5 * (0.5 - x).square(), 0.75 - x.square(), 0.5 * (0.5 + x).square()]
    elif kernel == "cubic":
        first = offset.detach().floor() - 1
        x = offset - first - 1
        weights = [(1 - x) ** 3 / 6, x**3 / 2 - x**2 + 2 / 3, (1 - x) ** 3 / 2 - (1 - x) ** 2 + 2 / 3, x**3 / 6]
    else:
        first = offset.detach().floor()
        x = offset - first
        near, far = x**3 / 2 - x**2 + 2 / 3, (1 - x) ** 3 / 2 - (1 - x) ** 2 + 2 / 3
        weights = [near / (near + far), far / (near + far)]
    return first.long(), torch.stack(weights, dim=-1)


def build_stencil(
    positions: Tensor,
    spacing_m: float,
    shape: tuple[int, int, int],
    kernel: Kernel,
    batch: Tensor | None = None,
    batches: int = 1,
) -> Stencil:
    """Find the nodes around each particle.

    Args:
        positions: Relative to the grid's origin, shape [N, 3] [m]. The grid must leave two cells of
            room around every particle; nodes beyond it are clamped to its border.
        spacing_m: Distance of two nodes [m].
        shape: Nodes along x, y, z.
        kernel: Name of the kernel.
        batch: Grid of each particle, shape [N], int64, when several grids of one shape lie behind each other.
        batches: Number of those grids.

    Returns:
        The stencil with 8, 27 or 64 nodes a particle.
    """
    offset = positions / spacing_m
    size = shape[0] * shape[1] * shape[2]
    shift = batch * size if batch is not None else torch.zeros(len(offset), dtype=torch.int64, device=offset.device)
    return Stencil(offset, kernel, shift, shape, batches * size)
