"""Transfers between particles and grid: p2g and g2p (PLOP, Eq. 20-21).

On the CPU the two linear maps below are numba kernels with hand-written gradients: `gather` runs
over particles in parallel, `scatter` adds into a few partial grids and sums them, so that the result
depends neither on timing nor on the number of threads. On CUDA both are index operations of PyTorch.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from plop.compute.cpu_kernels import array_of, kernel, run_parallel
from plop.dynamics.particle_grid.kernels import Stencil

_CHUNKS = 4
"""Number of partial grids of a scatter; fixed, so that sums are the same for any number of threads."""


@kernel
def _gather(
    part: int, parts: int, features: np.ndarray, nodes: np.ndarray, weights: np.ndarray, out: np.ndarray
) -> None:
    """Process three nodes at a time, so that `out` is read and written a third as often."""
    count, touched = nodes.shape
    for p in range(part * count // parts, (part + 1) * count // parts):
        for k in range(0, touched - 2, 3):
            a, b, c = nodes[p, k], nodes[p, k + 1], nodes[p, k + 2]
            of_a, of_b, of_c = weights[p, k], weights[p, k + 1], weights[p, k + 2]
            for column in range(features.shape[1]):
                out[p, column] += of_a * features[a, column] + of_b * features[b, column] + of_c * features[c, column]
        for k in range(touched - touched % 3, touched):
            for column in range(features.shape[1]):
                out[p, column] += weights[p, k] * features[nodes[p, k], column]


@kernel
def _scatter(
    part: int, parts: int, values: np.ndarray, nodes: np.ndarray, weights: np.ndarray, partial: np.ndarray
) -> None:
    """The last column of the partial grids is the sum of the weights."""
    count, touched = nodes.shape
    columns = values.shape[1]
    for p in range(part * count // parts, (part + 1) * count // parts):
        for k in range(touched):
            node, weight = nodes[p, k], weights[p, k]
            for c in range(columns):
                partial[part, node, c] += weight * values[p, c]
            partial[part, node, columns] += weight


@kernel
def _weight_gradient(
    part: int, parts: int, values: np.ndarray, features: np.ndarray, nodes: np.ndarray, out: np.ndarray
) -> None:
    """Treat a last column that only the features have as values of 1."""
    count, touched = nodes.shape
    columns = values.shape[1]
    for p in range(part * count // parts, (part + 1) * count // parts):
        for k in range(touched):
            node = nodes[p, k]
            for c in range(columns):
                out[p, k] += values[p, c] * features[node, c]
            if features.shape[1] > columns:
                out[p, k] += features[node, columns]


def _gather_any(features: Tensor, stencil: tuple[Tensor, Tensor]) -> Tensor:
    nodes, weights = stencil
    if features.device.type == "cpu":
        out = features.new_zeros(len(nodes), features.shape[1])
        run_parallel([(_gather, (array_of(features), array_of(nodes), array_of(weights), out.numpy()))], lent=True)
        return out
    return (features[nodes] * weights[..., None]).sum(1)


def _scatter_any(values: Tensor, stencil: tuple[Tensor, Tensor], node_count: int) -> Tensor:
    nodes, weights = stencil
    if values.device.type == "cpu":
        partial = values.new_zeros(_CHUNKS, node_count, values.shape[1] + 1)
        step = (_scatter, (array_of(values), array_of(nodes), array_of(weights), partial.numpy()))
        run_parallel([step], parts=_CHUNKS, lent=True)
        return partial.sum(0)
    values = _with_ones(values)
    out = values.new_zeros(node_count, values.shape[1])
    spread = (values[:, None, :] * weights[..., None]).flatten(0, 1)
    return out.index_add_(0, nodes.flatten(), spread)


def _with_ones(values: Tensor) -> Tensor:
    return torch.cat([values, values.new_ones(len(values), 1)], dim=1)


def _weight_gradient_any(values: Tensor, features: Tensor, nodes: Tensor) -> Tensor:
    if values.device.type == "cpu":
        out = values.new_zeros(nodes.shape)
        arguments = (array_of(values), array_of(features), array_of(nodes), out.numpy())
        run_parallel([(_weight_gradient, arguments)], lent=True)
        return out
    values = _with_ones(values) if features.shape[1] > values.shape[1] else values
    return (features[nodes] * values[:, None, :]).sum(-1)


class _Gather(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, features: Tensor, weights: Tensor, nodes: Tensor) -> Tensor:
        ctx.save_for_backward(features, weights, nodes)
        return _gather_any(features, (nodes, weights))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        features, weights, nodes = ctx.saved_tensors
        (grad,) = gradients
        needed = ctx.needs_input_grad[0]
        to_features = _scatter_any(grad, (nodes, weights), features.shape[0])[:, :-1] if needed else None
        to_weights = _weight_gradient_any(grad, features, nodes) if ctx.needs_input_grad[1] else None
        return to_features, to_weights, None


class _Scatter(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, weights: Tensor, nodes: Tensor, node_count: int) -> Tensor:
        ctx.save_for_backward(values, weights, nodes)
        return _scatter_any(values, (nodes, weights), node_count)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        values, weights, nodes = ctx.saved_tensors
        (grad,) = gradients
        to_values = _gather_any(grad[:, :-1], (nodes, weights)) if ctx.needs_input_grad[0] else None
        to_weights = _weight_gradient_any(values, grad, nodes) if ctx.needs_input_grad[1] else None
        return to_values, to_weights, None, None


def g2p(features: Tensor, stencil: Stencil) -> Tensor:
    """Interpolate node features to particles (Eq. 21).

    Args:
        features: Shape [nodes, C].
        stencil: Nodes and weights of N particles.

    Returns:
        Particle features, shape [N, C]; differentiable with respect to features and positions.
    """
    gathered: Tensor = _Gather.apply(features, stencil.weights, stencil.nodes)
    return gathered


def p2g_sums(values: Tensor, stencil: Stencil) -> tuple[Tensor, Tensor]:
    """Add particle values to the nodes, weighted.

    Args:
        values: Shape [N, C].
        stencil: Nodes and weights of the N particles.

    Returns:
        sum_p w_ip v_p, shape [nodes, C], and the mass sum_p w_ip, shape [nodes, 1].
    """
    total = _Scatter.apply(values, stencil.weights, stencil.nodes, stencil.node_count)
    return total[:, :-1], total[:, -1:]


def p2g(values: Tensor, stencil: Stencil) -> tuple[Tensor, Tensor]:
    """Average particle features on the nodes (Eq. 20).

    Args:
        values: Shape [N, C].
        stencil: Nodes and weights of the N particles.

    Returns:
        Node features, shape [nodes, C], exactly 0 where no particle is near; mass (sum of weights), shape [nodes, 1].
    """
    total, mass = p2g_sums(values, stencil)
    return total / mass.clamp_min(1e-12), mass
