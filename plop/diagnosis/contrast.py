"""Is there more of a law in the recordings than in the reference? Asked for any way of dealing the episodes out.

In episode e a hypothesis changes residuals by R_e times an amount. With the inverse covariance P of the discrepancy
model, everything that can be asked of it stands in the products

    G[e, f] = R_e' P_ef R_f        g[e] = sum_f R_e' P_ef r_f

of E by E and E numbers. Amounts are s in all episodes (what the base lacks there, too) and s + a in those to explain,
z = 1; without a reference s is 0. Amounts are in units of the amplitude at which the response was computed, so that a
law that is there at that amplitude has a = 1; only a > 0 counts, since the other way is another hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FREEDOM = 4.0
"""Degrees of freedom of noise and of what an episode is off by: few enough for a part that breaks loose, and for one
motion that goes wrong; the variance is finite."""
_SINGULAR = 1e-9


def roots(gains: np.ndarray) -> np.ndarray:
    """Signed square roots: a gain of log density grows with the square of an effect, and one episode may hold most."""
    return np.asarray(np.sign(gains) * np.sqrt(np.abs(gains)))


@dataclass(frozen=True)
class Products:
    """What the evidence says of one hypothesis."""

    gram: np.ndarray
    """[E, E]."""
    onto: np.ndarray
    """[E]."""

    @property
    def freedom(self) -> float:
        """Degrees of freedom with which the scale of a strength is known where nothing is hidden.

        Those are the episodes that tell something of the hypothesis, less s and a, and no fewer than those of the
        scale that all episodes share. A strength is a sum of roots: episodes are counted (Kish's effective number) by
        the root of how much each tells.
        """
        told = np.sqrt(np.diag(self.gram))
        return max(float(told.sum() ** 2 / max((told**2).sum(), 1e-300)) - 2.0, FREEDOM)

    def contrast(self, here: np.ndarray) -> Contrast:
        """Fit a and, where some episodes are a reference, s by generalised least squares.

        Args:
            here: Which episodes are to be explained, bool [E].
        """
        count, z = len(here), here.astype(float)
        design = z[:, None] if here.all() else np.stack([z, np.ones(count)], 1)
        hessian = design.T @ self.gram @ design
        if not _regular(hessian):
            return Contrast(0.0, np.inf, 1)
        inverse = np.linalg.inv(hessian)
        fitted = inverse @ design.T @ self.onto
        left = self.onto - self.gram @ design @ fitted
        pulls = (design @ inverse[0]) * left
        freedom = max(count - design.shape[1], 1)
        variance = inverse[0, 0] + (pulls**2).sum() * count / freedom
        return Contrast(float(fitted[0]), float(np.sqrt(variance)), freedom)

    def held_out(self, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Predict each episode to explain with the amounts that all others show.

        The hypothesis stands against the same without a, so that what is in the reference, too, is no gain.

        Args:
            labels: Which episodes are to be explained, 0 or 1, [N, E]; N ways of dealing them out.

        Returns:
            Gain of log density [nats], and the a that the others show, 0 where it is negative; [N, E] each, 0 in the
            reference.
        """
        z, alone = labels, bool((labels > 0).all())
        row, pulled, own = self.gram.sum(1), labels @ self.gram, np.diag(self.gram)
        # sums over all episodes but one, [N, E]: of s with s, s with a, a with a, and both with the residuals
        ss = row.sum() - 2 * row + own
        sa = (z @ row)[:, None] - z * row - pulled + z * own
        aa = (pulled * z).sum(1)[:, None] - 2 * z * pulled + z * own
        s, a = self.onto.sum() - self.onto, (z @ self.onto)[:, None] - z * self.onto
        if alone:
            volume, pull = aa, a
        else:
            safe = np.where(ss > 0, ss, np.inf)
            volume, pull = aa - sa**2 / safe, a - sa * s / safe
        usable = volume > _SINGULAR * max(float(own.sum()), 1e-300)
        amount = np.where(usable, np.maximum(pull / np.where(usable, volume, 1.0), 0.0), 0.0)
        plain = np.zeros(z.shape[1]) if alone else s / np.where(ss > 0, ss, np.inf)
        shared = plain if alone else (s - sa * amount) / np.where(ss > 0, ss, np.inf)

        def density(s: np.ndarray, a: np.ndarray) -> np.ndarray:
            """Log density over that without any amount, all other episodes given."""
            total = s + a * z
            left = self.onto - s * (row - own) - a * (pulled - z * own)
            return np.asarray(total * left - 0.5 * total**2 * own)

        gains = np.where(amount > 0, density(shared, amount) - density(plain, 0.0 * amount), 0.0)
        return gains * z, amount * z

    def strength(self, labels: np.ndarray) -> np.ndarray:
        """Sum of the roots of the gains, for N ways of dealing the episodes out, [N]: what ranks and is tested."""
        return np.asarray(roots(self.held_out(labels)[0]).sum(1))

    def with_amount(self, change: float, here: np.ndarray) -> Products:
        """Give what the evidence would say with so much more of the law in the episodes to explain."""
        return Products(self.gram, self.onto + change * self.gram @ here.astype(float))


@dataclass(frozen=True)
class Contrast:
    """A fitted amount."""

    amount: float
    """a."""
    error: float
    """Its standard error: that of the discrepancy model and that by the scatter of episodes (sandwich) together."""
    freedom: int
    """Degrees of freedom of the scatter."""


def _regular(hessian: np.ndarray) -> bool:
    values = np.linalg.eigvalsh(hessian)
    return bool(values[-1] > 0 and values[0] > _SINGULAR * values[-1])
