"""Sums over pairs of neighbours, with hand-written gradients: the costly part of the physical terms.

On the CPU, one pass over the pairs without intermediate tensors; on other devices, PyTorch's own operations.
The torch forms are the reference in tests.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from plop.compute.cpu_kernels import array_of, kernel

TINY = 1e-20
"""Keeps roots differentiable at 0."""


@kernel
def _rotated_error(i: int, j: int, turns: np.ndarray, now: np.ndarray, then: np.ndarray, error: np.ndarray) -> None:
    """R_i^T (now_j - now_i) - (then_j - then_i)."""
    for c in range(3):
        error[c] = then[i, c] - then[j, c]
        for d in range(3):
            error[c] += turns[i, d, c] * (now[j, d] - now[i, d])


@kernel
def _rigid(
    first: np.ndarray,
    second: np.ndarray,
    weight: np.ndarray,
    turns: np.ndarray,
    now: np.ndarray,
    then: np.ndarray,
    to_turns: np.ndarray,
    to_now: np.ndarray,
    to_then: np.ndarray,
) -> float:
    """Sum of sqrt(w |error|^2 + TINY), and its gradients."""
    total, error = 0.0, np.empty(3)
    for p in range(len(first)):
        i, j = first[p], second[p]
        _rotated_error(i, j, turns, now, then, error)
        root = np.sqrt(weight[p] * (error[0] ** 2 + error[1] ** 2 + error[2] ** 2) + TINY)
        total += root
        for c in range(3):
            slope = weight[p] * error[c] / root
            to_then[j, c] -= slope
            to_then[i, c] += slope
            for d in range(3):
                to_now[j, d] += turns[i, d, c] * slope
                to_now[i, d] -= turns[i, d, c] * slope
                to_turns[i, d, c] += (now[j, d] - now[i, d]) * slope
    return total


@kernel
def _alike(
    first: np.ndarray, second: np.ndarray, weight: np.ndarray, values: np.ndarray, to_values: np.ndarray
) -> float:
    """Sum of sqrt(w |value_j - value_i|^2 + TINY), and its gradient."""
    total = 0.0
    for p in range(len(first)):
        i, j = first[p], second[p]
        square = 0.0
        for c in range(values.shape[1]):
            square += (values[j, c] - values[i, c]) ** 2
        root = np.sqrt(weight[p] * square + TINY)
        total += root
        for c in range(values.shape[1]):
            slope = weight[p] * (values[j, c] - values[i, c]) / root
            to_values[j, c] += slope
            to_values[i, c] -= slope
    return total


@kernel
def _stretched(
    first: np.ndarray, second: np.ndarray, weight: np.ndarray, rest: np.ndarray, means: np.ndarray, to_means: np.ndarray
) -> float:
    """Sum of sqrt(w (length - rest)^2 + TINY), and its gradient."""
    total = 0.0
    for p in range(len(first)):
        i, j = first[p], second[p]
        square = TINY
        for c in range(3):
            square += (means[j, c] - means[i, c]) ** 2
        length = np.sqrt(square)
        root = np.sqrt(weight[p] * (length - rest[p]) ** 2 + TINY)
        total += root
        slope = weight[p] * (length - rest[p]) / (root * length)
        for c in range(3):
            to_means[j, c] += slope * (means[j, c] - means[i, c])
            to_means[i, c] -= slope * (means[j, c] - means[i, c])
    return total


class _Summed(torch.autograd.Function):
    """A kernel's sum over pairs; its gradients are computed in the forward pass."""

    @staticmethod
    def forward(ctx: Any, function: Any, pairs: tuple[Tensor, ...], *values: Tensor) -> Tensor:
        arrays = [array_of(value) for value in values]
        # Sums of thousands of terms of both signs: kept in double precision, like the total.
        slopes = [np.zeros(array.shape) for array in arrays]
        total = function(*(pair.numpy() for pair in pairs), *arrays, *slopes)
        ctx.save_for_backward(*(torch.from_numpy(s).to(v) for s, v in zip(slopes, values, strict=True)))
        return values[0].new_tensor(total)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        (grad,) = gradients
        return (None, None, *(grad * slope for slope in ctx.saved_tensors))


def rigid_sum(first: Tensor, second: Tensor, weight: Tensor, turns: Tensor, now: Tensor, then: Tensor) -> Tensor:
    """Add up sqrt(w |R_i^T (now_j - now_i) - (then_j - then_i)|^2).

    Args:
        first: Index i, shape [E], int64.
        second: Index j, shape [E], int64.
        weight: Shape [E].
        turns: R, shape [N, 3, 3].
        now: Shape [N, 3].
        then: Shape [N, 3].

    Returns:
        A scalar, differentiable in turns, now and then.
    """
    if now.device.type == "cpu":
        total: Tensor = _Summed.apply(_rigid, (first, second, weight), turns, now, then)
        return total
    error = torch.einsum("eji,ej->ei", turns[first], now[second] - now[first]) - (then[second] - then[first])
    return (weight * error.square().sum(-1) + TINY).sqrt().sum()


def alike_sum(first: Tensor, second: Tensor, weight: Tensor, values: Tensor) -> Tensor:
    """Add up sqrt(w |value_j - value_i|^2), values of shape [N, C]; a scalar, differentiable in them."""
    if values.device.type == "cpu":
        total: Tensor = _Summed.apply(_alike, (first, second, weight), values)
        return total
    return (weight * (values[second] - values[first]).square().sum(-1) + TINY).sqrt().sum()


def stretched_sum(first: Tensor, second: Tensor, weight: Tensor, rest_m: Tensor, means: Tensor) -> Tensor:
    """Add up sqrt(w (|mean_j - mean_i| - rest)^2), means of shape [N, 3]; a scalar, differentiable in them."""
    if means.device.type == "cpu":
        total: Tensor = _Summed.apply(_stretched, (first, second, weight, rest_m), means)
        return total
    length = ((means[second] - means[first]).square().sum(-1) + TINY).sqrt()
    return (weight * (length - rest_m).square() + TINY).sqrt().sum()
