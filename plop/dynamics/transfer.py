"""Transfers between particles and grid: p2g and g2p (PLOP, Eq. 20-21).

On the CPU the two linear maps below are numba kernels with hand-written gradients, which make the nodes and weights
of a particle as they need them: `gather` runs over particles in parallel, `scatter` adds into a few partial grids and
sums them, so that the result depends neither on timing nor on the number of threads. On CUDA both are index
operations of PyTorch; these are the reference in tests.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from plop.compiled import array_of, kernel, run_parallel
from plop.dynamics.kernels import NODES_PER_AXIS, Stencil

_CHUNKS = 4
"""Number of partial grids of a scatter; fixed, so that sums are the same for any number of threads."""

Places = tuple[np.ndarray, int, np.ndarray, tuple[int, int, int]]
"""A stencil for kernels: offset, nodes along an axis, shift, shape."""


@kernel
def _axis(offset: float, n: int, weights: np.ndarray, slopes: np.ndarray) -> int:
    """The first node along an axis; fills the weights of n nodes and their derivatives, as `axis_weights` does."""
    if n == 3:
        first = np.floor(offset + 0.5) - 1
        x = offset - first - 1
        weights[0], weights[1], weights[2] = 0.5 * (0.5 - x) ** 2, 0.75 - x * x, 0.5 * (0.5 + x) ** 2
        slopes[0], slopes[1], slopes[2] = x - 0.5, -2 * x, x + 0.5
        return int(first)
    first = np.floor(offset)
    x = offset - first
    y = 1 - x
    near, far = x**3 / 2 - x**2 + 2 / 3, y**3 / 2 - y**2 + 2 / 3
    to_near, to_far = 1.5 * x**2 - 2 * x, 2 * y - 1.5 * y**2
    if n == 4:
        weights[0], weights[1], weights[2], weights[3] = y**3 / 6, near, far, x**3 / 6
        slopes[0], slopes[1], slopes[2], slopes[3] = -0.5 * y**2, to_near, to_far, 0.5 * x**2
        return int(first) - 1
    both = near + far
    weights[0], weights[1] = near / both, far / both
    slopes[0] = (to_near * far - near * to_far) / both**2
    slopes[1] = -slopes[0]
    return int(first)


@kernel
def _clamped(index: int, count: int) -> int:
    return min(max(index, 0), count - 1)


@kernel
def _along(p: int, places: Places, weights: np.ndarray, slopes: np.ndarray) -> tuple[int, int, int]:
    """The first node of a particle along each axis; fills weights and slopes along the axes [3, 4], 0 beyond n."""
    offset, n = places[0], places[1]
    fx = _axis(offset[p, 0], n, weights[0], slopes[0])
    fy = _axis(offset[p, 1], n, weights[1], slopes[1])
    return fx, fy, _axis(offset[p, 2], n, weights[2], slopes[2])


@kernel
def _row(
    p: int, i: int, j: int, first: tuple[int, int, int], weights: np.ndarray, places: Places
) -> tuple[int, int, int, int, float, float, float, float]:  # fmt: skip
    """Four nodes along z and their weights, 0 beyond n: all at a time takes a third less time than a loop over them."""
    shift, shape = places[2], places[3]
    row = (_clamped(first[0] + i, shape[0]) * shape[1] + _clamped(first[1] + j, shape[1])) * shape[2] + shift[p]
    a, b = row + _clamped(first[2], shape[2]), row + _clamped(first[2] + 1, shape[2])
    c, d = row + _clamped(first[2] + 2, shape[2]), row + _clamped(first[2] + 3, shape[2])
    w = weights[0, i] * weights[1, j]
    return a, b, c, d, w * weights[2, 0], w * weights[2, 1], w * weights[2, 2], w * weights[2, 3]


@kernel
def _gather(part: int, parts: int, features: np.ndarray, places: Places, out: np.ndarray) -> None:
    count, n = len(places[0]), places[1]
    weights, slopes = np.zeros((3, 4), out.dtype), np.zeros((3, 4), out.dtype)
    for p in range(part * count // parts, (part + 1) * count // parts):
        first = _along(p, places, weights, slopes)
        for i in range(n):
            for j in range(n):
                a, b, c, d, wa, wb, wc, wd = _row(p, i, j, first, weights, places)
                for q in range(features.shape[1]):
                    out[p, q] += wa * features[a, q] + wb * features[b, q] + wc * features[c, q] + wd * features[d, q]


@kernel
def _scatter(
    part: int, parts: int, values: np.ndarray, places: Places, partial: np.ndarray, mass: np.ndarray
) -> None:  # fmt: skip
    count, n = len(places[0]), places[1]
    weights, slopes = np.zeros((3, 4), mass.dtype), np.zeros((3, 4), mass.dtype)
    sums, total = partial[part], mass[part]
    for p in range(part * count // parts, (part + 1) * count // parts):
        first = _along(p, places, weights, slopes)
        for i in range(n):
            for j in range(n):
                a, b, c, d, wa, wb, wc, wd = _row(p, i, j, first, weights, places)
                total[a] += wa
                total[b] += wb
                total[c] += wc
                total[d] += wd
                for q in range(values.shape[1]):
                    sums[a, q] += wa * values[p, q]
                    sums[b, q] += wb * values[p, q]
                    sums[c, q] += wc * values[p, q]
                    sums[d, q] += wd * values[p, q]


@kernel
def _offset_gradient(
    part: int, parts: int, values: np.ndarray, features: np.ndarray, constant: np.ndarray, places: Places,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Derivative of sum_k w_k (values . features_k + constant_k) with respect to the offset."""
    offset, n, shift, shape = places
    weights, slopes = np.zeros((3, 4), out.dtype), np.zeros((3, 4), out.dtype)
    for p in range(part * len(offset) // parts, (part + 1) * len(offset) // parts):
        fx, fy, fz = _along(p, places, weights, slopes)
        for i in range(n):
            ix = _clamped(fx + i, shape[0])
            for j in range(n):
                row = (ix * shape[1] + _clamped(fy + j, shape[1])) * shape[2] + shift[p]
                total, change = 0 * out[p, 0], 0 * out[p, 0]
                for m in range(n):
                    node = row + _clamped(fz + m, shape[2])
                    told = constant[node]
                    for q in range(values.shape[1]):
                        told += values[p, q] * features[node, q]
                    total += told * weights[2, m]
                    change += told * slopes[2, m]
                out[p, 0] += total * slopes[0, i] * weights[1, j]
                out[p, 1] += total * weights[0, i] * slopes[1, j]
                out[p, 2] += change * weights[0, i] * weights[1, j]


def _places(stencil: Stencil) -> Places:
    return array_of(stencil.offset), NODES_PER_AXIS[stencil.kernel], array_of(stencil.shift), stencil.shape


def _gather_cpu(features: Tensor, stencil: Stencil) -> Tensor:
    out = features.new_zeros(len(stencil.offset), features.shape[1])
    run_parallel([(_gather, (array_of(features), _places(stencil), out.numpy()))])
    return out


def _scatter_cpu(values: Tensor, stencil: Stencil) -> tuple[Tensor, Tensor]:
    partial = values.new_zeros(_CHUNKS, stencil.node_count, values.shape[1])
    mass = values.new_zeros(_CHUNKS, stencil.node_count)
    step = (_scatter, (array_of(values), _places(stencil), partial.numpy(), mass.numpy()))
    run_parallel([step], parts=_CHUNKS)
    return partial.sum(0), mass.sum(0)


def _offset_gradient_cpu(values: Tensor, features: Tensor, constant: Tensor, stencil: Stencil) -> Tensor:
    out = values.new_zeros(len(values), 3)
    arrays = (array_of(values), array_of(features), array_of(constant))
    run_parallel([(_offset_gradient, (*arrays, _places(stencil), out.numpy()))])
    return out


class _Gather(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, features: Tensor, offset: Tensor, stencil: Stencil) -> Tensor:
        ctx.save_for_backward(features)
        ctx.stencil = stencil
        return _gather_cpu(features, stencil)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        (features,) = ctx.saved_tensors
        (grad,) = gradients
        to_features = _scatter_cpu(grad, ctx.stencil)[0] if ctx.needs_input_grad[0] else None
        zeros = features.new_zeros(len(features))
        to_offset = _offset_gradient_cpu(grad, features, zeros, ctx.stencil) if ctx.needs_input_grad[1] else None
        return to_features, to_offset, None


class _Scatter(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, offset: Tensor, stencil: Stencil) -> tuple[Tensor, Tensor]:
        ctx.save_for_backward(values)
        ctx.stencil = stencil
        return _scatter_cpu(values, stencil)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        (values,) = ctx.saved_tensors
        grad, of_mass = gradients
        to_values = _gather_cpu(grad, ctx.stencil) if ctx.needs_input_grad[0] else None
        to_offset = _offset_gradient_cpu(values, grad, of_mass, ctx.stencil) if ctx.needs_input_grad[1] else None
        return to_values, to_offset, None


def g2p(features: Tensor, stencil: Stencil) -> Tensor:
    """Interpolate node features to particles (Eq. 21).

    Args:
        features: Shape [nodes, C].
        stencil: Nodes and weights of N particles.

    Returns:
        Particle features, shape [N, C]; differentiable with respect to features and positions.
    """
    return (
        _Gather.apply(features, stencil.offset, stencil) if features.device.type == "cpu" else gather(features, stencil)
    )


def gather(features: Tensor, stencil: Stencil) -> Tensor:
    """Do the same with PyTorch's operations, on any device."""
    nodes, weights = stencil.spread()
    return (features[nodes] * weights[..., None]).sum(1)


def p2g_sum(values: Tensor, stencil: Stencil) -> tuple[Tensor, Tensor]:
    """Add particle values to the nodes, weighted.

    Args:
        values: v, shape [N, C].
        stencil: Nodes and weights of the N particles.

    Returns:
        sum_p w_ip v_p, shape [nodes, C]; sum_p w_ip, shape [nodes].
    """
    return _Scatter.apply(values, stencil.offset, stencil) if values.device.type == "cpu" else scatter(values, stencil)


def scatter(values: Tensor, stencil: Stencil) -> tuple[Tensor, Tensor]:
    """Do the same with PyTorch's operations, on any device."""
    nodes, weights = stencil.spread()
    out, mass = values.new_zeros(stencil.node_count, values.shape[1]), values.new_zeros(stencil.node_count)
    spread = (values[:, None, :] * weights[..., None]).flatten(0, 1)
    return out.index_add(0, nodes.flatten(), spread), mass.index_add(0, nodes.flatten(), weights.flatten())


def p2g(values: Tensor, stencil: Stencil) -> tuple[Tensor, Tensor]:
    """Average particle features on the nodes (Eq. 20).

    Args:
        values: Shape [N, C].
        stencil: Nodes and weights of the N particles.

    Returns:
        Node features, shape [nodes, C], exactly 0 where no particle is near; mass (sum of weights), shape [nodes, 1].
    """
    total, mass = p2g_sum(values, stencil)
    return total / mass.clamp_min(1e-12)[:, None], mass[:, None]
