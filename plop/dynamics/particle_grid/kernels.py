"""Interpolation kernels between particles and grid nodes (PLOP, Eq. 18-19).

Three kernels, all normalised so that the weights of one particle sum to 1:

- `paper`: the one printed branch of the cubic, |x| < h, 2 nodes per axis. Its weight at |x| = h
  is 1/6 before normalisation, so features jump when a particle crosses a cell.
- `quadratic`: quadratic B-spline, 3 nodes per axis, smooth.
- `cubic`: full cubic B-spline with both branches, 4 nodes per axis, smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from plop.compute.cpu_kernels import array_of, run_parallel
from plop.compute.cpu_kernels import kernel as compiled

Kernel = Literal["paper", "quadratic", "cubic"]
NODES_PER_AXIS: dict[str, int] = {"paper": 2, "quadratic": 3, "cubic": 4}


@dataclass(frozen=True)
class Stencil:
    """The nodes that each particle contributes to, and the weights."""

    nodes: Tensor
    """Flat node indices, shape [N, K], int64."""
    weights: Tensor
    """Weights, shape [N, K], each row sums to 1; differentiable with respect to the positions."""
    node_count: int
    """Number of nodes of the grid (of all grids of a batch)."""


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
        batch: Grid of each particle, shape [N], int64, when several grids of one shape are concatenated.
        batches: Number of those grids.

    Returns:
        The stencil with K = 8, 27 or 64 nodes per particle.
    """
    offset = positions / spacing_m
    size = shape[0] * shape[1] * shape[2]
    shift = torch.zeros(len(offset), dtype=torch.int64, device=offset.device) if batch is None else batch * size
    if offset.device.type == "cpu":
        nodes, product = _Compiled.apply(offset, shift, shape, NODES_PER_AXIS[kernel])
    else:
        nodes, product = _spread(*axis_weights(offset, kernel), shift, shape)
    return Stencil(nodes, product, batches * size)


def _spread(first: Tensor, weights: Tensor, shift: Tensor, shape: tuple[int, int, int]) -> tuple[Tensor, Tensor]:
    steps = torch.arange(weights.shape[-1], device=first.device)
    limit = torch.tensor(shape, device=first.device)[:, None] - 1
    index = (first[..., None] + steps).clamp_min(0).minimum(limit)
    ix, iy, iz = index[:, 0], index[:, 1], index[:, 2]
    nodes = (ix[:, :, None, None] * shape[1] + iy[:, None, :, None]) * shape[2] + iz[:, None, None, :]
    wx, wy, wz = weights[:, 0], weights[:, 1], weights[:, 2]
    product = wx[:, :, None, None] * wy[:, None, :, None] * wz[:, None, None, :]
    return nodes.flatten(1) + shift[:, None], product.flatten(1)


class _Compiled(torch.autograd.Function):
    """From offsets in spacings, [N, 3], to nodes and weights, [N, n^3], with hand-written gradients."""

    @staticmethod
    def forward(
        ctx: Any, offset: Tensor, shift: Tensor, shape: tuple[int, int, int], nodes_per_axis: int
    ) -> tuple[Tensor, Tensor]:
        count, n = len(offset), nodes_per_axis
        nodes, product = shift.new_empty(count, n**3), offset.new_empty(count, n**3)
        first, weights = shift.new_empty(count, 3), offset.new_empty(count, 3, n)
        along = (array_of(offset), first.numpy(), weights.detach().numpy())
        spread = (*along[1:], array_of(shift), shape, nodes.numpy(), product.detach().numpy())
        run_parallel([(_fill_axes, along), (_fill_stencil, spread)], lent=True)
        ctx.save_for_backward(offset, weights)
        ctx.mark_non_differentiable(nodes)
        return nodes, product

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        offset, weights = ctx.saved_tensors
        out = torch.zeros_like(offset)
        arguments = (array_of(offset), array_of(weights), array_of(gradients[1]), out.numpy())
        run_parallel([(_fill_slopes, arguments)], lent=True)
        return out, None, None, None


@compiled
def _fill_axes(part: int, parts: int, offset: np.ndarray, first: np.ndarray, weights: np.ndarray) -> None:
    """`axis_weights`; the kernel follows from the number of nodes."""
    count, _, n = weights.shape
    for p in range(part * count // parts, (part + 1) * count // parts):
        for axis in range(3):
            w = weights[p, axis]
            if n == 3:
                node = np.floor(offset[p, axis] + 0.5) - 1
                x = offset[p, axis] - node - 1
                w[0], w[1], w[2] = 0.5 * (0.5 - x) ** 2, 0.75 - x * x, 0.5 * (0.5 + x) ** 2
            else:
                node = np.floor(offset[p, axis])
                x = offset[p, axis] - node
                y = 1 - x
                near, far = x * x * x / 2 - x * x + 2 / 3, y * y * y / 2 - y * y + 2 / 3
                if n == 2:
                    w[0], w[1] = near / (near + far), far / (near + far)
                else:
                    node -= 1
                    w[0], w[1], w[2], w[3] = y * y * y / 6, near, far, x * x * x / 6
            first[p, axis] = int(node)


@compiled
def _axis_slopes(offset: float, w: np.ndarray, slopes: np.ndarray) -> None:
    """Derivatives of a particle's weights along one axis with respect to its offset."""
    if len(w) == 3:
        x = offset - np.floor(offset + 0.5)
        slopes[0], slopes[1], slopes[2] = x - 0.5, -2 * x, x + 0.5
        return
    x = offset - np.floor(offset)
    y = 1 - x
    near, far = 1.5 * x * x - 2 * x, 2 * y - 1.5 * y * y
    if len(w) == 4:
        slopes[0], slopes[1], slopes[2], slopes[3] = -0.5 * y * y, near, far, 0.5 * x * x
    else:
        total = (x * x * x + y * y * y) / 2 - x * x - y * y + 4 / 3
        slopes[0] = (near - w[0] * (near + far)) / total
        slopes[1] = -slopes[0]


@compiled
def _fill_stencil(
    part: int,
    parts: int,
    first: np.ndarray,
    weights: np.ndarray,
    shift: np.ndarray,
    shape: tuple[int, int, int],
    nodes: np.ndarray,
    product: np.ndarray,
) -> None:
    """Nodes beyond the grid are clamped to its border."""
    count, _, n = weights.shape
    for p in range(part * count // parts, (part + 1) * count // parts):
        k = 0
        for i in range(n):
            ix = min(max(first[p, 0] + i, 0), shape[0] - 1)
            for j in range(n):
                iy = min(max(first[p, 1] + j, 0), shape[1] - 1)
                row, both = (ix * shape[1] + iy) * shape[2] + shift[p], weights[p, 0, i] * weights[p, 1, j]
                for m in range(n):
                    nodes[p, k] = row + min(max(first[p, 2] + m, 0), shape[2] - 1)
                    product[p, k] = both * weights[p, 2, m]
                    k += 1


@compiled
def _fill_slopes(
    part: int, parts: int, offset: np.ndarray, weights: np.ndarray, grad: np.ndarray, out: np.ndarray
) -> None:
    """From gradients of the products to gradients of the offsets."""
    count, _, n = weights.shape
    to_weights, slopes = np.empty((3, n)), np.empty(n)
    for p in range(part * count // parts, (part + 1) * count // parts):
        to_weights[:] = 0
        k = 0
        for i in range(n):
            for j in range(n):
                along = weights[p, 0, i] * weights[p, 1, j]
                total = 0 * along
                for m in range(n):
                    total += grad[p, k] * weights[p, 2, m]
                    to_weights[2, m] += grad[p, k] * along
                    k += 1
                to_weights[0, i] += total * weights[p, 1, j]
                to_weights[1, j] += total * weights[p, 0, i]
        for axis in range(3):
            _axis_slopes(offset[p, axis], weights[p, axis], slopes)
            for i in range(n):
                out[p, axis] += to_weights[axis, i] * slopes[i]
