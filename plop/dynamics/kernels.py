"""Interpolation kernels between particles and grid nodes (PLOP, Eq. 18-19).

Three kernels, all normalised so that the weights of one particle sum to 1:

- `paper`: the one printed branch of the cubic, |x| < h, 2 nodes an axis. Its weight at |x| = h
  is 1/6 before normalisation, so features jump when a particle crosses a cell.
- `quadratic`: quadratic B-spline, 3 nodes an axis, smooth.
- `cubic`: full cubic B-spline with both branches, 4 nodes an axis, smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from plop.compiled import array_of, run_parallel
from plop.compiled import kernel as compiled

Kernel = Literal["paper", "quadratic", "cubic"]
NODES_PER_AXIS: dict[str, int] = {"paper": 2, "quadratic": 3, "cubic": 4}


@dataclass(frozen=True)
class Stencil:
    """The nodes that each particle touches, and how strongly."""

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
        batch: Grid of each particle, shape [N], int64, when several grids of one shape lie behind each other.
        batches: Number of those grids.

    Returns:
        The stencil with K = 8, 27 or 64 nodes a particle.
    """
    first, weights = axis_weights(positions / spacing_m, kernel)
    size = shape[0] * shape[1] * shape[2]
    shift = torch.zeros_like(first[:, 0]) if batch is None else batch * size
    nodes, product = _Product.apply(first, weights, shift, shape)
    return Stencil(nodes, product, batches * size)


class _Product(torch.autograd.Function):
    """From the first node and the weights along each axis to all nodes and their weights, [N, n^3]."""

    @staticmethod
    def forward(
        ctx: Any, first: Tensor, weights: Tensor, shift: Tensor, shape: tuple[int, int, int]
    ) -> tuple[Tensor, Tensor]:
        ctx.save_for_backward(weights)
        nodes, product = (_spread_cpu if weights.device.type == "cpu" else _spread)(first, weights, shift, shape)
        ctx.mark_non_differentiable(nodes)
        return nodes, product

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        (weights,) = ctx.saved_tensors
        grad = gradients[1]
        return None, (_slopes_cpu if weights.device.type == "cpu" else _slopes)(weights, grad), None, None


def _spread(first: Tensor, weights: Tensor, shift: Tensor, shape: tuple[int, int, int]) -> tuple[Tensor, Tensor]:
    steps = torch.arange(weights.shape[-1], device=first.device)
    limit = torch.tensor(shape, device=first.device)[:, None] - 1
    index = (first[..., None] + steps).clamp_min(0).minimum(limit)
    ix, iy, iz = index[:, 0], index[:, 1], index[:, 2]
    nodes = (ix[:, :, None, None] * shape[1] + iy[:, None, :, None]) * shape[2] + iz[:, None, None, :]
    wx, wy, wz = weights[:, 0], weights[:, 1], weights[:, 2]
    product = wx[:, :, None, None] * wy[:, None, :, None] * wz[:, None, None, :]
    return nodes.flatten(1) + shift[:, None], product.flatten(1)


def _slopes(weights: Tensor, grad: Tensor) -> Tensor:
    n = weights.shape[-1]
    wx, wy, wz = weights[:, 0], weights[:, 1], weights[:, 2]
    cube = grad.reshape(-1, n, n, n)
    terms = ("pijk,pj,pk->pi", wy, wz), ("pijk,pi,pk->pj", wx, wz), ("pijk,pi,pj->pk", wx, wy)
    return torch.stack([torch.einsum(form, cube, one, other) for form, one, other in terms], dim=1)


def _spread_cpu(first: Tensor, weights: Tensor, shift: Tensor, shape: tuple[int, int, int]) -> tuple[Tensor, Tensor]:
    count, n = len(first), weights.shape[-1]
    nodes, product = first.new_empty(count, n**3), weights.new_empty(count, n**3)
    arguments = (array_of(first), array_of(weights), array_of(shift), shape, nodes.numpy(), product.detach().numpy())
    run_parallel([(_fill_stencil, arguments)])
    return nodes, product


def _slopes_cpu(weights: Tensor, grad: Tensor) -> Tensor:
    out = torch.zeros_like(weights)
    run_parallel([(_fill_slopes, (array_of(weights), array_of(grad), out.numpy()))])
    return out


@compiled
def _fill_stencil(
    part: int, parts: int, first: np.ndarray, weights: np.ndarray, shift: np.ndarray, shape: tuple[int, int, int],
    nodes: np.ndarray, product: np.ndarray,
) -> None:  # fmt: skip
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
def _fill_slopes(part: int, parts: int, weights: np.ndarray, grad: np.ndarray, out: np.ndarray) -> None:
    """Derivatives of the products with respect to the weights along each axis."""
    count, _, n = weights.shape
    for p in range(part * count // parts, (part + 1) * count // parts):
        k = 0
        for i in range(n):
            for j in range(n):
                along = weights[p, 0, i] * weights[p, 1, j]
                total = 0 * along
                for m in range(n):
                    total += grad[p, k] * weights[p, 2, m]
                    out[p, 2, m] += grad[p, k] * along
                    k += 1
                out[p, 0, i] += total * weights[p, 1, j]
                out[p, 1, j] += total * weights[p, 0, i]
