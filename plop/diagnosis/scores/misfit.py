"""Is the base further off in the recordings than in the reference, whatever is missing?

A law that the library lacks may displace the object in another direction in every motion: no field of displacements is
common to the recordings, and yet all of them are explained less well than the reference. Compared is the logarithm of
the misfit of each episode, which a part that breaks loose does not decide, in units of what is expected: noise, which
is known, and an error in proportion to the motion, of which the share is fitted to all episodes. With a share that is
too large, recordings with more noise than the reference would seem to be explained less well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import t as student

_LOG_FACTORS = -12.0, 6.0
"""From nothing that is missed to all that is measured [-]."""
_LEAST = 2
"""Episodes of a kind of motion in each of the two sets that tell how much such episodes scatter."""
_TINY = 1e-12


def misfits(
    squares: Sequence[np.ndarray], noise: Sequence[np.ndarray], missed: Sequence[np.ndarray], freedom: float
) -> np.ndarray:
    """Give the mean negative log density (Student's t, but for a constant) of each episode, [E].

    Args:
        squares: Squared residual of every patch and frame that was seen, [N] [m^2] for each episode.
        noise: Squared scale of its noise [m^2].
        missed: Squared scale of what a base misses, but for a factor, the same in all [m^2].
        freedom: Degrees of freedom.
    """
    each = list(zip(squares, noise, missed, strict=True))

    def scaled(factor: float) -> list[tuple[np.ndarray, np.ndarray]]:
        return [((q / (n + factor * m)) / freedom, n + factor * m) for q, n, m in each]

    def unlikely(log_factor: float) -> float:
        terms = scaled(float(np.exp(log_factor)))
        return float(sum(((freedom + 3) / 2 * np.log1p(q) + 1.5 * np.log(scale)).mean() for q, scale in terms))

    factor = float(np.exp(minimize_scalar(unlikely, bounds=_LOG_FACTORS, method="bounded").x))
    return np.array([((freedom + 3) / 2 * np.log1p(q)).mean() for q, _ in scaled(factor)])


def differences(found: np.ndarray, ways: np.ndarray, kinds: Sequence[str]) -> np.ndarray:
    """Give how far the recordings' misfits exceed the reference's, in standard errors, for ways of dealing out, [N].

    Compared within kinds of motion; over all episodes at once where a kind has too few of either. That ways are counted
    makes no assumption on how misfits scatter: some motions are far less well explained than others of their kind.

    Args:
        found: Misfit of every episode, [E].
        ways: Labels 0 or 1 of which episodes are to be explained, the real ones first, [N, E].
        kinds: Kind of motion of every episode.
    """
    groups = [np.array([k == kind for k in kinds]) for kind in dict.fromkeys(kinds)]
    real = ways[0] > 0
    if any(min((real & g).sum(), (~real & g).sum()) < _LEAST for g in groups):
        groups = [np.ones(len(found), bool)]
    apart, variance = np.zeros(len(ways)), np.zeros(len(ways))
    for group in groups:
        own, values = ways[:, group], found[group] - found[group].mean()
        counts = own.sum(1), (1 - own).sum(1)
        both = np.minimum(*counts) > 0  # a way may leave a kind to one set
        here, there = (np.maximum(count, 1) for count in counts)
        mean, other = own @ values / here, (1 - own) @ values / there
        within = own @ values**2 - here * mean**2 + (1 - own) @ values**2 - there * other**2
        apart += both * here * (mean - other)
        variance += both * within / max(len(values) - 2, 1) * here**2 * (1 / here + 1 / there)
    return np.asarray(apart / np.sqrt(np.maximum(variance, _TINY)))


def outlying(found: np.ndarray, here: np.ndarray, kinds: Sequence[str], chance: float) -> list[int]:
    """Find recordings whose misfit no other explains: each against the others of its kind of motion (t prediction).

    Args:
        found: Misfit of every episode, [E].
        here: Which episodes are to be explained, bool [E].
        kinds: Kind of motion of every episode; where fewer than three others are of a kind, all others count.
        chance: Of finding any by chance.

    Returns:
        Indices among all episodes.
    """
    same, count = np.array([[a == b for b in kinds] for a in kinds]), len(found)
    alone = []
    for k in np.flatnonzero(here):
        others = np.arange(count) != k
        group = others & same[k] if (others & same[k]).sum() > _LEAST else others
        known = found[group]
        error = max(float(known.std(ddof=1)), 1e-12) * np.sqrt(1 + 1 / len(known))
        if student.sf((found[k] - known.mean()) / error, len(known) - 1) * here.sum() <= chance:
            alone.append(int(k))
    return alone
