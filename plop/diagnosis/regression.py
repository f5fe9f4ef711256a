"""Explain residuals by columns, episode by episode: least squares from Gram matrices, scored on held-out episodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.diagnosis.evidence import Whitened
from plop.statistics.cluster_robust import Clusters, clusters

_RIDGE = 1e-9
KNOWN_LEAST = 0.03
"""Least share of the reference's held-out error that a column must take away to belong to the known misfit."""


@dataclass(frozen=True)
class Grams:
    """All that least squares needs of E episodes with C columns."""

    hessian: np.ndarray
    """[E, C, C]."""
    gradient: np.ndarray
    """[E, C]."""
    energy: np.ndarray
    """Sum of squared residuals, [E]."""

    @classmethod
    def of(cls, episodes: list[Whitened]) -> Grams:
        """Multiply out."""
        return cls(
            np.stack([e.matrix @ e.matrix.T for e in episodes]),
            np.stack([e.matrix @ e.residual for e in episodes]),
            np.array([e.residual @ e.residual for e in episodes]),
        )

    def with_residuals(self, episodes: list[Whitened]) -> Grams:
        """Multiply out other residuals of the same responses."""
        gradient, energy = zip(*((e.matrix @ e.residual, e.residual @ e.residual) for e in episodes), strict=True)
        return Grams(self.hessian, np.stack(gradient), np.array(energy))

    def signed(self, signs: np.ndarray) -> Grams:
        """Flip the residuals of some episodes; signs [E] of +1 and -1."""
        return Grams(self.hessian, self.gradient * signs[:, None], self.energy)


def solve(hessian: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Least squares for a stack of systems, [..., C, C] and [..., C] -> [..., C].

    Columns are scaled to unit length first; a tiny ridge leaves a column without response at 0.
    """
    scale = np.sqrt(np.maximum(np.diagonal(hessian, axis1=-2, axis2=-1), 1e-30))
    normal = hessian / (scale[..., :, None] * scale[..., None, :])
    normal = normal + _RIDGE * np.eye(hessian.shape[-1])
    return np.linalg.solve(normal, (gradient / scale)[..., None])[..., 0] / scale


def held_out_energy(grams: Grams, columns: np.ndarray) -> np.ndarray:
    """Sum of squares left in each episode when the columns were fitted to all others, [E].

    Args:
        grams: At least two episodes.
        columns: Indices of the columns; none leaves the residuals as they are.
    """
    if len(columns) == 0:
        return grams.energy
    hessian, gradient = grams.hessian[:, columns][:, :, columns], grams.gradient[:, columns]
    return _energy(grams.energy, hessian, gradient, held_out_values(grams, columns))


def _energy(energy: np.ndarray, hessian: np.ndarray, gradient: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Sum of squares left in each episode at some values, [C] or [E, C] -> [E]."""
    values = np.broadcast_to(values, gradient.shape)
    return energy - 2 * (gradient * values).sum(-1) + np.einsum("ec,ecd,ed->e", values, hessian, values)


def held_out_values(grams: Grams, columns: np.ndarray) -> np.ndarray:
    """Fit columns to all episodes but one, for each one; [E, C]."""
    hessian, gradient = grams.hessian[:, columns][:, :, columns], grams.gradient[:, columns]
    return solve(hessian.sum(0) - hessian, gradient.sum(0) - gradient)


def fit(grams: Grams, columns: np.ndarray) -> Clusters:
    """Fit columns to all episodes; episodes, not points, are what counts as independent."""
    return clusters(grams.hessian[:, columns][:, :, columns], grams.gradient[:, columns])


def energy_left(grams: Grams, columns: np.ndarray) -> np.ndarray:
    """Sum of squares left in each episode when the columns were fitted to all, itself too, [E]."""
    if len(columns) == 0:
        return grams.energy
    hessian, gradient = grams.hessian[:, columns][:, :, columns], grams.gradient[:, columns]
    return _energy(grams.energy, hessian, gradient, solve(hessian.sum(0), gradient.sum(0)))


def known_misfit(reference: Grams, base: np.ndarray, groups: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Describe what the base misses where nothing is hidden, as a mixture of few columns.

    Forward selection by held-out error among the reference episodes. The result is a description, not a
    finding: it is taken off before anything is tested.

    Args:
        reference: Episodes that the base was fitted to.
        base: Columns of the base's own parameters, always in.
        groups: Columns of each candidate.

    Returns:
        Mixture [C], and the sum of squares that it leaves in each episode when fitted to the others [E].
    """
    values = np.zeros(reference.gradient.shape[1])
    if len(reference.energy) < 3:
        return values, reference.energy
    chosen, left = base, held_out_energy(reference, base).sum()
    while groups:
        trials = [held_out_energy(reference, np.concatenate([chosen, group])).sum() for group in groups]
        best = int(np.argmin(trials))
        if trials[best] > (1 - KNOWN_LEAST) * left:
            break
        chosen, left = np.concatenate([chosen, groups[best]]), trials[best]
        groups = [g for k, g in enumerate(groups) if k != best and not set(g) & set(chosen)]
    if len(chosen):
        values[chosen] = fit(reference, chosen).values
    return values, held_out_energy(reference, chosen)


def gain(before: np.ndarray, after: np.ndarray) -> float:
    """Share of the squared error that is gone [-]; before and after per episode, [E]."""
    return float(1 - after.sum() / max(before.sum(), 1e-30))


def steady_gain(before: np.ndarray, after: np.ndarray) -> float:
    """Gain over all episodes but the one that gains most [-]: what misleads in one motion does not count."""
    rest = np.arange(len(before)) != most_helped(before, after)
    return gain(before[rest], after[rest])


def most_helped(before: np.ndarray, after: np.ndarray) -> int:
    """Number of the episode that gains most."""
    return int(np.argmax(before - after))
