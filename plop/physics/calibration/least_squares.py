"""Least squares over episodes: weights, normal equations, and intervals of the parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from plop.parameters import Estimate, Parameter
from plop.physics.calibration.posterior import roots_of_weights
from plop.statistics.cluster_robust import clusters


def weighed(
    jacobian: list[list[np.ndarray]], residual: list[np.ndarray]
) -> tuple[list[list[np.ndarray]], list[np.ndarray]]:
    """Multiply derivatives [parameter][episode] and residuals [episode] by the roots of the weights of episodes."""
    weights = roots_of_weights(residual)
    return [_scaled(row, weights) for row in jacobian], _scaled(residual, weights)


def _scaled(rows: list[np.ndarray], weights: np.ndarray) -> list[np.ndarray]:
    return [w * row for w, row in zip(weights, rows, strict=True)]


def normal_equations(jacobian: list[list[np.ndarray]], residual: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Hessian [P, P] and gradient [P] of half the squares."""
    flat = np.stack([np.concatenate([j.ravel() for j in row]) for row in jacobian])
    return flat @ flat.T, flat @ np.concatenate([r.ravel() for r in residual])


def intervals(
    parameters: Sequence[Parameter], here: np.ndarray, jacobian: list[list[np.ndarray]], residual: list[np.ndarray]
) -> dict[str, Estimate]:
    """Give 95 % intervals of what the data tell, without a prior.

    They come from the scatter between independent blocks (episodes; with fewer than four, fifths of an episode),
    because errors of neighbouring points and frames are correlated; blocks are weighted by leverage (`clusters`).

    Args:
        parameters: P.
        here: Coordinates of the fit, [P].
        jacobian: Weighed, [parameter][episode].
        residual: Weighed, [episode].

    Returns:
        Estimates by name; infinite for a parameter at its bound, or one without influence on the data.
    """
    values = [p.decode(c) for p, c in zip(parameters, here, strict=True)]
    bound = np.array([v <= p.low or v >= p.high for v, p in zip(values, parameters, strict=True)])
    width = np.full(len(here), np.inf)
    hessian, _ = normal_equations(jacobian, residual)
    free = np.nonzero(~bound)[0]
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    normal = hessian / np.outer(scale, scale)
    if len(free) and np.linalg.eigvalsh(normal[np.ix_(free, free)])[0] > 1e-6:
        found = clusters(*_blocks([jacobian[k] for k in free], residual))
        width[free] = student.ppf(0.975, found.freedom) * np.sqrt(np.diag(found.spread))
    ends = [
        (-np.inf, np.inf) if np.isinf(w) else (p.decode(c - w), p.decode(c + w))
        for p, c, w in zip(parameters, here, width, strict=True)
    ]
    return {
        p.name: Estimate(v, low, high, p.unit, bool(b)).within(p)
        for p, v, (low, high), b in zip(parameters, values, ends, bound, strict=True)
    }


def _blocks(jacobian: list[list[np.ndarray]], residual: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Hessian [blocks, P, P] and negative gradient [blocks, P] of half the cost in each independent block."""
    found = []
    for episode, r in enumerate(residual):
        pieces = np.array_split(np.arange(len(r)), 1 if len(residual) >= 4 else min(5, len(r)))
        found += [normal_equations([[row[episode][piece]] for row in jacobian], [r[piece]]) for piece in pieces]
    return np.stack([hessian for hessian, _ in found]), -np.stack([gradient for _, gradient in found])
