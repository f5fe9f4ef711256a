"""Is there more of a law in the recordings than in the reference? Asked for any way of dealing the episodes out.

In episode e a hypothesis changes residuals by R_e times an amount. With the inverse covariance P of the discrepancy
model, everything that can be asked of it stands in the products

    G[e, f] = R_e' P_ef R_f        g[e] = sum_f R_e' P_ef r_f

of E by E and E numbers. Amounts are s in all episodes (what the base lacks there, too) and s + a in those to explain,
z = 1; without a reference s is 0. Amounts are in units of the amplitude at which the response was computed, so that a law
that is there at that amplitude has a = 1; only a > 0 counts, since the other way is another hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

_SINGULAR = 1e-9


@dataclass(frozen=True)
class Products:
    """What the evidence says of one hypothesis."""

    gram: np.ndarray
    """[E, E]."""
    onto: np.ndarray
    """[E]."""

    def contrast(self, labels: np.ndarray) -> Contrast:
        """Fit a and, where some episodes are a reference, s by generalised least squares.

        Args:
            labels: Which episodes are to be explained, 0 or 1, [N, E]; N ways of dealing them out.
        """
        count = len(self.onto)
        row, pulled = self.gram.sum(1), labels @ self.gram
        own, cross = (pulled * labels).sum(1), labels @ row
        alone = bool((labels > 0).all())
        shared = np.inf if alone else max(float(row.sum()), 1e-300)
        volume = own - cross**2 / shared
        usable = volume > _SINGULAR * max(float(np.trace(self.gram)), 1e-300)
        volume = np.where(usable, volume, 1.0)
        a = np.where(usable, (labels @ self.onto - cross / shared * self.onto.sum()) / volume, 0.0)
        s = np.zeros(len(labels)) if alone else (self.onto.sum() - cross * a) / shared
        left = self.onto - s[:, None] * row - a[:, None] * pulled
        pulls = (labels - (cross / shared)[:, None]) * left / volume[:, None]
        freedom = max(count - (1 if alone else 2), 1)
        variance = np.where(usable, 1 / volume + (pulls**2).sum(1) * count / freedom, np.inf)
        return Contrast(a, np.sqrt(variance), s, freedom)

    def held_out(self, here: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Predict each episode to explain with the amounts that all others show.

        The hypothesis stands against the same without a, so that what is in the reference, too, is no gain.

        Args:
            here: Which episodes are to be explained, bool [E].

        Returns:
            Gain of log density of each [H] [nats], and the a that the others show [H], 0 where it is negative.
        """
        design = np.stack([np.ones(len(here)), here.astype(float)], 1)
        gains, amounts = [], []
        for e in np.flatnonzero(here):
            others = np.arange(len(here)) != e
            fitted, plain = self._amounts(design, others, here), self._amounts(design * [1.0, 0.0], others, here)
            helps = fitted[1] > 0
            amounts.append(max(float(fitted[1]), 0.0))
            gains.append(self._density(e, design @ fitted) - self._density(e, design @ plain) if helps else 0.0)
        return np.array(gains), np.array(amounts)

    def _amounts(self, design: np.ndarray, used: np.ndarray, here: np.ndarray) -> np.ndarray:
        """Least squares for s and a over some episodes; without a reference s is 0."""
        columns = design[used] * ([0.0, 1.0] if here.all() else [1.0, 1.0])
        hessian = columns.T @ self.gram[np.ix_(used, used)] @ columns
        ridge = _SINGULAR * max(float(np.trace(hessian)), 1e-300)
        return np.asarray(np.linalg.solve(hessian + ridge * np.eye(2), columns.T @ self.onto[used]))

    def _density(self, e: int, amount: np.ndarray) -> float:
        """Log density of an episode with amounts [E], over that without any, all other episodes given."""
        others = np.arange(len(amount)) != e
        left = self.onto[e] - self.gram[e, others] @ amount[others]
        return float(amount[e] * left - 0.5 * amount[e] ** 2 * self.gram[e, e])


@dataclass(frozen=True)
class Contrast:
    """Fitted amounts, for N ways of dealing the episodes out."""

    amount: np.ndarray
    """a, [N]."""
    error: np.ndarray
    """Its standard error, [N]: that of the discrepancy model and that by the scatter of episodes (sandwich) together."""
    shared: np.ndarray
    """s, [N]."""
    freedom: int
    """Degrees of freedom of the scatter."""

    @cached_property
    def errors(self) -> np.ndarray:
        """Distance of a from 0 in standard errors, [N]; 0 where a is negative."""
        return np.asarray(np.maximum(self.amount / self.error, 0.0))
