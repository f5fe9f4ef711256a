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

from plop.compiled import array_of, kernel, run_parallel
from plop.dynamics.kernels import Stencil

_CHUNKS = 4
"""Number of partial grids of a scatter; fixed, so that sums are the same for any number of threads."""


@kernel
def _gather(
    part: int, parts: int, features: np.ndarray, nodes: np.ndarray, weights: np.ndarray, out: np.ndarray
) -> None:
    count, touched = nodes.shape
    for p in range(part * count // parts, (part + 1) * count // parts):
        for k in range(touched):
            node, weight = nodes[p, k], weights[p, k]
            for c in range(features.shape[1]):
                out[p, c] += weight * features[node, c]


@kernel
def _scatter(
    part: int, parts: int, values: np.ndarray, nodes: np.ndarray, weights: np.ndarray, partial: np.ndarray
) -> None:
    count, touched = nodes.shape
    for p in range(part * count // parts, (part + 1) * count // parts):
        for k in range(touched):
            node, weight = nodes[p, k], weights[p, k]
            for c in range(values.shape[1]):
                partial[part, node, c] += weight * values[p, c]


@kernel
def _weight_gradient(
    part: int, parts: int, values: np.ndarray, features: np.ndarray, nodes: np.ndarray, out: np.ndarray
) -> None:
    count, touched = nodes.shape
    for p in range(part * count // parts, (part + 1) * count // parts):
        for k in range(touched):
            node = nodes[p, k]
            for c in range(values.shape[1]):
                out[p, k] += values[p, c] * features[node, c]


def _gather_any(features: Tensor, stencil: tuple[Tensor, Tensor]) -> Tensor:
    nodes, weights = stencil
    if features.device.type == "cpu":
        out = features.new_zeros(len(nodes), features.shape[1])
        run_parallel([(_gather, (array_of(features), array_of(nodes), array_of(weights), out.numpy()))])
        return out
    return (features[nodes] * weights[..., None]).sum(1)


def _scatter_any(values: Tensor, stencil: tuple[Tensor, Tensor], node_count: int) -> Tensor:
    nodes, weights = stencil
    if values.device.type == "cpu":
        partial = values.new_zeros(_CHUNKS, node_count, values.shape[1])
        step = (_scatter, (array_of(values), array_of(nodes), array_of(weights), partial.numpy()))
        run_parallel([step], parts=_CHUNKS)
        return partial.sum(0)
    out = values.new_zeros(node_count, values.shape[1])
    spread = (values[:, None, :] * weights[..., None]).flatten(0, 1)
    return out.index_add_(0, nodes.flatten(), spread)


def _weight_gradient_any(values: Tensor, features: Tensor, nodes: Tensor) -> Tensor:
    if values.device.type == "cpu":
        out = values.new_zeros(nodes.shape)
        run_parallel([(_weight_gradient, (array_of(values), array_of(features), array_of(nodes), out.numpy()))])
        return out
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
        to_features = _scatter_any(grad, (nodes, weights), features.shape[0]) if ctx.needs_input_grad[0] else None
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
        to_values = _gather_any(grad, (nodes, weights)) if ctx.needs_input_grad[0] else None
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
    return _Gather.apply(features, stencil.weights, stencil.nodes)


def p2g_sum(values: Tensor, stencil: Stencil) -> Tensor:
    """Add particle values to the nodes, weighted: sum_p w_ip v_p, shape [N, C] -> [nodes, C]."""
    return _Scatter.apply(values, stencil.weights, stencil.nodes, stencil.node_count)


def p2g(values: Tensor, stencil: Stencil) -> tuple[Tensor, Tensor]:
    """Average particle features on the nodes (Eq. 20).

    Args:
        values: Shape [N, C].
        stencil: Nodes and weights of the N particles.

    Returns:
        Node features, shape [nodes, C], exactly 0 where no particle is near; mass (sum of weights), shape [nodes, 1].
    """
    ones = values.new_ones(values.shape[0], 1)
    total = p2g_sum(torch.cat([values, ones], dim=1), stencil)
    mass = total[:, -1:]
    return total[:, :-1] / mass.clamp_min(1e-12), mass
