"""Least squares over few episodes that do not tell alike: spreads that are not too small, and how many tell them.

An episode that holds much of what is known of an amplitude pulls the fit towards itself, so that its residual is
smaller than its error. The usual sandwich takes it as it is, and counts all episodes as telling the scatter, also those
that say nothing. Here residuals are put right by how much they are pulled, and degrees of freedom are counted by
what the episodes hold (Bell and McCaffrey, Survey Methodology 28, 2002: bias-reduced linearisation; Pustejovsky and
Tipton, J. Business & Economic Statistics 36, 2018), both as they would be where an episode scatters as it
is sensitive.

By hand, since statsmodels' cluster-robust covariance has neither this correction nor these degrees of freedom, without
which eight episodes look more certain than they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

PRIOR_FREEDOM = 4.0
"""See `Clusters.steadied`; a round number."""
LOUDNESS = 0.5
"""Power of what an episode holds with which its squared residuals are taken to grow, see `loudness`."""
_RIDGE = 1e-9
_UNPULLED = 1e-4
"""Least share of its own error that an episode's residual must keep for it to tell anything of the scatter."""


@dataclass(frozen=True)
class Clusters:
    """What E episodes hold of C amplitudes."""

    values: np.ndarray
    """Fitted amplitudes, [C]."""
    pulls: np.ndarray
    """How far each episode pulls the fit, put right, [E, C]; the covariance of the fit is the sum of their squares."""
    expected: np.ndarray
    """Covariance of `pulls` if each episode scattered as it is sensitive, [E, E, C, C], in units of that scatter."""
    whole: np.ndarray
    """Covariance of the fit in that case, [C, C]."""
    likely: np.ndarray
    """Covariance of the fit if the scatter of episodes grew with what they hold as `loudness` says, [C, C], in units of
    `scatter`."""
    scatter: float
    """Mean square of what is left in all episodes, in these units."""
    shown: float
    """Over how many numbers that is the mean; what the fit has taken up does not count."""
    inverse: np.ndarray
    """Inverse of what all episodes and the prior hold together, [C, C]; of no meaning once `mapped`."""

    def mapped(self, matrix: np.ndarray) -> Clusters:
        """Give linear combinations of the amplitudes, [D, C]."""
        return replace(
            self,
            values=matrix @ self.values,
            pulls=self.pulls @ matrix.T,
            expected=matrix @ self.expected @ matrix.T,
            whole=matrix @ self.whole @ matrix.T,
            likely=matrix @ self.likely @ matrix.T,
        )

    def averaged(self, matrix: np.ndarray, loud: float) -> Clusters:
        """Give one more error, as large as these are on average, mapped by a matrix [D, C]; see `loudness`."""
        whole = matrix @ matrix.T
        return replace(self.mapped(matrix / np.sqrt(len(self.pulls))), whole=whole, likely=loud * whole)

    @property
    def spread(self) -> np.ndarray:
        """Covariance of the fit, [C, C]; infinite where one episode alone tells, which knows no scatter."""
        told = self.told
        scale = np.where(told > 0, 1 / np.sqrt(np.maximum(told, _UNPULLED)), np.inf)
        with np.errstate(invalid="ignore"):
            spread = self.pulls.T @ self.pulls * np.outer(scale, scale)
        return np.where(np.isnan(spread), np.inf, spread)

    def steadied(self) -> tuple[np.ndarray, np.ndarray]:
        """Give variances [C] that are not left to one or two episodes, and their degrees of freedom [C].

        Where few episodes tell an amplitude, their residuals hardly tell how much it scatters. What all episodes show
        of all amplitudes, taken to scatter as `loudness` says, then counts as PRIOR_FREEDOM more of them do
        (Smyth, Statistical Applications in Genetics and Molecular Biology 3, 2004: moderated t). Narrower than `spread`
        and `freedom`, and as good as that assumption.
        """
        return steadied(np.diag(self.spread), self.freedom, self.scatter * np.diag(self.likely))

    @property
    def told(self) -> np.ndarray:
        """Share of each variance that the residuals still show, [C]: 1, or less where an episode holds nearly all."""
        shown = np.einsum("eecc->c", self.expected)
        share = shown / np.maximum(np.diag(self.whole), 1e-300)
        return np.where(share > _UNPULLED, share, 0.0)

    @property
    def freedom(self) -> np.ndarray:
        """Degrees of freedom with which each variance is known (Satterthwaite), at least 1, [C]."""
        trace = np.einsum("eecc->c", self.expected)
        squares = np.einsum("efcc,efcc->c", self.expected, self.expected)
        return np.maximum(trace**2 / np.maximum(squares, 1e-300), 1.0)


def steadied(own: np.ndarray, degrees: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average variances with what is expected of them, which counts as PRIOR_FREEDOM; see `Clusters.steadied`.

    Args:
        own: As the episodes show them, [C]; infinite where one alone tells.
        degrees: Their degrees of freedom, [C].
        expected: As they would be if all scattered as `loudness` says, [C].

    Returns:
        Variances and their degrees of freedom, [C].
    """
    degrees, own = np.where(np.isfinite(own), degrees, 0.0), np.where(np.isfinite(own), own, 0.0)
    return (degrees * own + PRIOR_FREEDOM * expected) / (degrees + PRIOR_FREEDOM), degrees + PRIOR_FREEDOM


def loudness(hessian: np.ndarray) -> np.ndarray:
    """Guess how large residuals of episodes are, squared, in units of how sensitive they are, [E]; about 1.

    Noise alone would make all alike. What a base misses grows with the motion, as responses do, so that an episode
    which holds much is not as exact as it is sensitive; if what is missed were as large an amplitude of the law in
    every episode, squared residuals would grow as what they hold. The truth lies between (LOUDNESS).

    Args:
        hessian: Of each episode, [E, C, C].
    """
    scale, inverse = _scaled(hessian.sum(0))
    held = np.einsum("ab,eba->e", inverse, hessian / np.outer(scale, scale)) * len(hessian) / max(len(scale), 1)
    return np.asarray(np.maximum(held, _UNPULLED) ** LOUDNESS)


def clusters(
    hessian: np.ndarray,
    gradient: np.ndarray,
    prior: tuple[np.ndarray, np.ndarray] | None = None,
    loud: np.ndarray | None = None,
) -> Clusters:
    """Fit amplitudes to all episodes.

    Args:
        hessian: Of each episode, [E, C, C].
        gradient: [E, C].
        prior: What is known before as another episode's hessian [C, C] and values [C], which count as exact.
        loud: See `loudness`, [E]; by these very hessians if not given.
    """
    known, guess = prior if prior is not None else (np.zeros(hessian.shape[1:]), np.zeros(hessian.shape[-1]))
    loud = loudness(hessian) if loud is None else loud
    scale, inverse = _scaled(hessian.sum(0) + known)
    units = np.outer(scale, scale)
    normal, right = hessian / units, gradient / scale
    values = inverse @ (right.sum(0) + (known @ guess) / scale)
    left = right - normal @ values
    righted = np.stack([_righted(one, inverse) for one in normal])
    to_fit = inverse @ righted
    expected = np.einsum("eab,efbc,fdc->efad", to_fit, _left_together(normal, inverse, np.ones(len(loud))), to_fit)
    whole, likely = (inverse @ np.tensordot(weights, normal, 1) @ inverse for weights in (np.ones(len(loud)), loud))
    scatter, shown = _scatter(left, righted, normal, _left_together(normal, inverse, loud))
    return Clusters(
        values / scale,
        np.einsum("ecd,ed->ec", to_fit, left) / scale,
        expected / units,
        whole / units,
        likely / units,
        scatter,
        shown,
        inverse / units,
    )


def _scaled(total: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give units in which the diagonal of a hessian is 1, [C], and its inverse in these units, [C, C]."""
    scale = np.sqrt(np.maximum(np.diag(total), 1e-30))
    return scale, np.linalg.inv(total / np.outer(scale, scale) + _RIDGE * np.eye(len(scale)))


def _left_together(normal: np.ndarray, inverse: np.ndarray, loud: np.ndarray) -> np.ndarray:
    """Covariance of what the fit leaves in episodes that are so loud, [E, E, C, C]."""
    own = loud[:, None, None] * normal
    whole = inverse @ own.sum(0) @ inverse
    pulled = np.einsum("eab,bc,fcd->efad", own, inverse, normal)
    found = np.einsum("eab,bc,fcd->efad", normal, whole, normal) - pulled - pulled.transpose(1, 0, 3, 2)
    found[np.arange(len(own)), np.arange(len(own))] += own
    return np.asarray(found)


def _scatter(left: np.ndarray, righted: np.ndarray, normal: np.ndarray, apart: np.ndarray) -> tuple[float, float]:
    """Mean square of what is left, put right, in units of how sensitive episodes are, and of how many numbers."""
    if not left.shape[-1]:
        return 1.0, 0.0
    units = np.stack([np.linalg.solve(root(one), right) for one, right in zip(normal, righted, strict=True)])
    squares = float((np.einsum("ecd,ed->ec", units, left) ** 2).sum())
    shown = float(np.einsum("eab,eebc,eac->", units, apart, units))
    return squares / max(shown, 1e-300), shown


def _righted(hessian: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Give the matrix that makes an episode's residual as large as its error, [C, C]."""
    sizes, axes = np.linalg.eigh(hessian)
    kept = sizes > 1e-9 * max(float(sizes.max(initial=0.0)), 1e-300)
    root, unroot = axes[:, kept] * np.sqrt(sizes[kept]), axes[:, kept] / np.sqrt(np.where(kept, sizes, 1.0)[kept])
    held, turned = np.linalg.eigh(root.T @ inverse @ root)
    stretch = 1 / np.sqrt(np.maximum(1 - held, _UNPULLED))
    return np.asarray(root @ (turned * stretch) @ turned.T @ unroot.T)


def together(parts: Sequence[Clusters]) -> Clusters:
    """Add independent fits: their values, and what pulls on them."""
    counts = [len(part.pulls) for part in parts]
    size = parts[0].pulls.shape[1]
    expected = np.zeros((sum(counts), sum(counts), size, size))
    at = 0
    for part, count in zip(parts, counts, strict=True):
        expected[at : at + count, at : at + count] = part.expected
        at += count
    shown = sum(part.shown for part in parts)
    scatter = sum(part.scatter * part.shown for part in parts) / max(shown, 1e-300)
    return Clusters(
        np.sum([part.values for part in parts], 0),
        np.concatenate([part.pulls for part in parts]),
        expected,
        np.sum([part.whole for part in parts], 0),
        np.sum([part.likely for part in parts], 0),
        scatter,
        shown,
        parts[0].inverse,
    )


def whitened(fitted: Clusters, hessian: np.ndarray) -> Clusters:
    """Give the pulls of episodes in units in which all scatter alike; hessian [E, C, C] as it was fitted."""
    total = np.linalg.inv(fitted.inverse)
    units = np.stack([np.linalg.solve(root(one), total) for one in hessian])
    expected = np.einsum("eab,efbc,fdc->efad", units, fitted.expected, units)
    return replace(fitted, pulls=np.einsum("ecd,ed->ec", units, fitted.pulls), expected=expected)


def root(hessian: np.ndarray) -> np.ndarray:
    """Give the lower triangle whose square is an episode's hessian, [C, C]."""
    ridge = 1e-6 * float(np.trace(hessian)) / len(hessian) + 1e-30
    return np.linalg.cholesky(hessian + ridge * np.eye(len(hessian)))
