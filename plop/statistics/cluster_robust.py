"""Cluster-robust least squares over few episodes of unequal leverage: bias-reduced covariance and degrees of freedom.

An episode with high leverage on an amplitude pulls the fit towards itself, so that its residual is smaller than its
error. The usual sandwich estimator uses the residual uncorrected, and counts all episodes as independent estimates of
the scatter, including those without information. Here residuals are corrected for leverage, and degrees of freedom
are computed from the information of the episodes (Bell and McCaffrey, Survey Methodology 28, 2002: bias-reduced
linearisation; Pustejovsky and Tipton, J. Business & Economic Statistics 36, 2018), both under the working assumption
that the scatter of an episode is proportional to its information.

No library, since statsmodels' cluster-robust covariance has neither this correction nor these degrees of freedom,
without which the intervals of eight episodes are too narrow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

PRIOR_FREEDOM = 4.0
"""Prior degrees of freedom, see `Clusters.steadied`; a round number."""
LOUDNESS = 0.5
"""Assumed exponent of the growth of an episode's squared residuals with its information, see `loudness`."""
_RIDGE = 1e-9
_UNPULLED = 1e-4
"""Smallest share of its own error that an episode's residual must retain to be informative about the scatter."""


@dataclass(frozen=True)
class Clusters:
    """Fit of C amplitudes to E episodes, with the contribution of each episode."""

    values: np.ndarray
    """Fitted amplitudes, [C]."""
    pulls: np.ndarray
    """Leverage-corrected contribution of each episode, [E, C]; the fit's covariance is the sum of their squares."""
    expected: np.ndarray
    """Covariance of `pulls` under the working assumption, [E, E, C, C], in units of the scatter."""
    whole: np.ndarray
    """Covariance of the fit under the working assumption, [C, C]."""
    likely: np.ndarray
    """Covariance of the fit if the scatter of episodes grows with their information as in `loudness`, [C, C], in
    units of `scatter`."""
    scatter: float
    """Mean squared residual of all episodes, in these units."""
    shown: float
    """Number of residual degrees of freedom of this mean."""
    inverse: np.ndarray
    """Inverse of the total information of all episodes and the prior, [C, C]; meaningless after `mapped`."""

    def mapped(self, matrix: np.ndarray) -> Clusters:
        """Return linear combinations of the amplitudes, [D, C]."""
        return replace(
            self,
            values=matrix @ self.values,
            pulls=self.pulls @ matrix.T,
            expected=matrix @ self.expected @ matrix.T,
            whole=matrix @ self.whole @ matrix.T,
            likely=matrix @ self.likely @ matrix.T,
        )

    def averaged(self, matrix: np.ndarray, relative: float) -> Clusters:
        """Return a further error, as large as these on average, mapped by a matrix [D, C]; see `loudness`."""
        whole = matrix @ matrix.T
        return replace(self.mapped(matrix / np.sqrt(len(self.pulls))), whole=whole, likely=relative * whole)

    @property
    def spread(self) -> np.ndarray:
        """Covariance of the fit, [C, C]; infinite where only one episode is informative, which gives no scatter."""
        informative = self.informative_share
        scale = np.where(informative > 0, 1 / np.sqrt(np.maximum(informative, _UNPULLED)), np.inf)
        with np.errstate(invalid="ignore"):
            spread = self.pulls.T @ self.pulls * np.outer(scale, scale)
        return np.where(np.isnan(spread), np.inf, spread)

    def steadied(self) -> tuple[np.ndarray, np.ndarray]:
        """Return moderated variances [C], which do not depend on one or two episodes only, and their degrees of
        freedom [C].

        Where few episodes determine an amplitude, their residuals hardly determine its scatter. The scatter of all
        amplitudes over all episodes, assumed to vary as in `loudness`, is then a prior with PRIOR_FREEDOM degrees
        of freedom (Smyth, Statistical Applications in Genetics and Molecular Biology 3, 2004: moderated t). Narrower
        than `spread` and `freedom`, and as good as that assumption.
        """
        return steadied(np.diag(self.spread), self.freedom, self.scatter * np.diag(self.likely))

    @property
    def informative_share(self) -> np.ndarray:
        """Share of each variance that is visible in the residuals, [C]: 1, or less at nearly full leverage."""
        shown = np.einsum("eecc->c", self.expected)
        share = shown / np.maximum(np.diag(self.whole), 1e-300)
        return np.where(share > _UNPULLED, share, 0.0)

    @property
    def freedom(self) -> np.ndarray:
        """Degrees of freedom of each variance (Satterthwaite), at least 1, [C]."""
        trace = np.einsum("eecc->c", self.expected)
        squares = np.einsum("efcc,efcc->c", self.expected, self.expected)
        return np.asarray(np.maximum(trace**2 / np.maximum(squares, 1e-300), 1.0))


def steadied(own: np.ndarray, degrees: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average variances with their prior, which has PRIOR_FREEDOM degrees of freedom; see `Clusters.steadied`.

    Args:
        own: Variances from the episodes, [C]; infinite where only one is informative.
        degrees: Their degrees of freedom, [C].
        expected: Prior variances, with the scatter of `loudness`, [C].

    Returns:
        Variances and their degrees of freedom, [C].
    """
    degrees, own = np.where(np.isfinite(own), degrees, 0.0), np.where(np.isfinite(own), own, 0.0)
    return (degrees * own + PRIOR_FREEDOM * expected) / (degrees + PRIOR_FREEDOM), degrees + PRIOR_FREEDOM


def loudness(hessian: np.ndarray) -> np.ndarray:
    """Estimate the squared residuals of episodes relative to the working assumption, [E]; about 1.

    With noise alone all would be equal. The model error of a base grows with the motion, as responses do, so that an
    episode with much information is less accurate than its sensitivity suggests; if the model error were the same
    amplitude of the law in every episode, squared residuals would grow in proportion to the information. The truth is
    between the two (LOUDNESS).

    Args:
        hessian: Hessian of each episode, [E, C, C].
    """
    scale, inverse = _scaled(hessian.sum(0))
    held = np.einsum("ab,eba->e", inverse, hessian / np.outer(scale, scale)) * len(hessian) / max(len(scale), 1)
    return np.asarray(np.maximum(held, _UNPULLED) ** LOUDNESS)


def clusters(
    hessian: np.ndarray,
    gradient: np.ndarray,
    prior: tuple[np.ndarray, np.ndarray] | None = None,
    relative: np.ndarray | None = None,
) -> Clusters:
    """Fit amplitudes to all episodes.

    Args:
        hessian: Hessian of each episode, [E, C, C].
        gradient: [E, C].
        prior: Prior information as a further episode's hessian [C, C] and values [C], treated as exact.
        relative: See `loudness`, [E]; from these hessians when absent.
    """
    known, guess = prior if prior is not None else (np.zeros(hessian.shape[1:]), np.zeros(hessian.shape[-1]))
    relative = loudness(hessian) if relative is None else relative
    scale, inverse = _scaled(hessian.sum(0) + known)
    units = np.outer(scale, scale)
    normal, right = hessian / units, gradient / scale
    values = inverse @ (right.sum(0) + (known @ guess) / scale)
    left = right - normal @ values
    righted = np.stack([_righted(one, inverse) for one in normal])
    to_fit = inverse @ righted
    expected = np.einsum("eab,efbc,fdc->efad", to_fit, _left_together(normal, inverse, np.ones(len(relative))), to_fit)
    whole, likely = (
        inverse @ np.tensordot(weights, normal, 1) @ inverse for weights in (np.ones(len(relative)), relative)
    )
    scatter, shown = _scatter(left, righted, normal, _left_together(normal, inverse, relative))
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
    """Return units in which the diagonal of a hessian is 1, [C], and its inverse in these units, [C, C]."""
    scale = np.sqrt(np.maximum(np.diag(total), 1e-30))
    return scale, np.linalg.inv(total / np.outer(scale, scale) + _RIDGE * np.eye(len(scale)))


def _left_together(normal: np.ndarray, inverse: np.ndarray, relative: np.ndarray) -> np.ndarray:
    """Covariance of the residuals of episodes with such a relative scatter, [E, E, C, C]."""
    own = relative[:, None, None] * normal
    whole = inverse @ own.sum(0) @ inverse
    pulled = np.einsum("eab,bc,fcd->efad", own, inverse, normal)
    found = np.einsum("eab,bc,fcd->efad", normal, whole, normal) - pulled - pulled.transpose(1, 0, 3, 2)
    found[np.arange(len(own)), np.arange(len(own))] += own
    return np.asarray(found)


def _scatter(left: np.ndarray, righted: np.ndarray, normal: np.ndarray, apart: np.ndarray) -> tuple[float, float]:
    """Mean of the corrected squared residuals under the working assumption, and their number of degrees of freedom."""
    if not left.shape[-1]:
        return 1.0, 0.0
    units = np.stack([np.linalg.solve(root(one), right) for one, right in zip(normal, righted, strict=True)])
    squares = float((np.einsum("ecd,ed->ec", units, left) ** 2).sum())
    shown = float(np.einsum("eab,eebc,eac->", units, apart, units))
    return squares / max(shown, 1e-300), shown


def _righted(hessian: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Return the matrix that corrects an episode's residual for leverage, [C, C]."""
    sizes, axes = np.linalg.eigh(hessian)
    kept = sizes > 1e-9 * max(float(sizes.max(initial=0.0)), 1e-300)
    root, unroot = axes[:, kept] * np.sqrt(sizes[kept]), axes[:, kept] / np.sqrt(np.where(kept, sizes, 1.0)[kept])
    held, turned = np.linalg.eigh(root.T @ inverse @ root)
    stretch = 1 / np.sqrt(np.maximum(1 - held, _UNPULLED))
    return np.asarray(root @ (turned * stretch) @ turned.T @ unroot.T)


def together(parts: Sequence[Clusters]) -> Clusters:
    """Add independent fits: their values and contributions."""
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
    """Return the contributions of episodes in units of equal scatter; hessian [E, C, C] as it was fitted."""
    total = np.linalg.inv(fitted.inverse)
    units = np.stack([np.linalg.solve(root(one), total) for one in hessian])
    expected = np.einsum("eab,efbc,fdc->efad", units, fitted.expected, units)
    return replace(fitted, pulls=np.einsum("ecd,ed->ec", units, fitted.pulls), expected=expected)


def root(hessian: np.ndarray) -> np.ndarray:
    """Return the lower triangle whose square is an episode's hessian, [C, C]."""
    ridge = 1e-6 * float(np.trace(hessian)) / len(hessian) + 1e-30
    return np.linalg.cholesky(hessian + ridge * np.eye(len(hessian)))
