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

from dataclasses import dataclass

import numpy as np

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

    @property
    def spread(self) -> np.ndarray:
        """Covariance of the fit, [C, C]; infinite where only one episode is informative, which gives no scatter."""
        informative = self.informative_share
        scale = np.where(informative > 0, 1 / np.sqrt(np.maximum(informative, _UNPULLED)), np.inf)
        with np.errstate(invalid="ignore"):
            spread = self.pulls.T @ self.pulls * np.outer(scale, scale)
        return np.where(np.isnan(spread), np.inf, spread)

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


def clusters(hessian: np.ndarray, gradient: np.ndarray) -> Clusters:
    """Fit amplitudes to all episodes.

    Args:
        hessian: Of each episode, [E, C, C].
        gradient: [E, C].
    """
    scale, inverse = _scaled(hessian.sum(0))
    units = np.outer(scale, scale)
    normal, right = hessian / units, gradient / scale
    values = inverse @ right.sum(0)
    left = right - normal @ values
    to_fit = inverse @ np.stack([_righted(one, inverse) for one in normal])
    expected = np.einsum("eab,efbc,fdc->efad", to_fit, _left_together(normal, inverse), to_fit)
    pulls = np.einsum("ecd,ed->ec", to_fit, left)
    whole = inverse @ normal.sum(0) @ inverse
    return Clusters(values / scale, pulls / scale, expected / units, whole / units)


def _scaled(total: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return units in which the diagonal of a hessian is 1, [C], and its inverse in these units, [C, C]."""
    scale = np.sqrt(np.maximum(np.diag(total), 1e-30))
    return scale, np.linalg.inv(total / np.outer(scale, scale) + _RIDGE * np.eye(len(scale)))


def _left_together(normal: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Covariance of the residual gradients of episodes under the working assumption, [E, E, C, C]."""
    whole = inverse @ normal.sum(0) @ inverse
    pulled = np.einsum("eab,bc,fcd->efad", normal, inverse, normal)
    found = np.einsum("eab,bc,fcd->efad", normal, whole, normal) - pulled - pulled.transpose(1, 0, 3, 2)
    found[np.arange(len(normal)), np.arange(len(normal))] += normal
    return np.asarray(found)


def _righted(hessian: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Return the matrix that corrects an episode's residual for leverage, [C, C]."""
    sizes, axes = np.linalg.eigh(hessian)
    kept = sizes > 1e-9 * max(float(sizes.max(initial=0.0)), 1e-300)
    root, unroot = axes[:, kept] * np.sqrt(sizes[kept]), axes[:, kept] / np.sqrt(np.where(kept, sizes, 1.0)[kept])
    held, turned = np.linalg.eigh(root.T @ inverse @ root)
    stretch = 1 / np.sqrt(np.maximum(1 - held, _UNPULLED))
    return np.asarray(root @ (turned * stretch) @ turned.T @ unroot.T)
