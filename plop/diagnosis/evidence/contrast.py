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

from plop.statistics.heavy_tails import FREEDOM

_SINGULAR = 1e-9
_ROUNDS = 5
"""In which a mean amount and the spread around it are found from each other."""


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

    def contrast(self, here: np.ndarray, spread: float = 0.0) -> Contrast:
        """Fit a and, where some episodes are a reference, s by generalised least squares.

        Args:
            here: Which episodes are to be explained, bool [E].
            spread: Standard deviation between their amounts: the larger, the more nearly all count alike.
        """
        design, normal = self._normal(here)
        if not _regular(normal):
            return Contrast(0.0, np.inf, 1)
        # covariance of g where amounts differ: G + spread^2 G diag(z) G
        onto = design.T @ np.linalg.inv(np.eye(len(here)) + spread**2 * self.gram * here)
        inverse = np.linalg.inv(onto @ self.gram @ design)
        fitted = inverse @ onto @ self.onto
        pulls = (inverse[0] @ onto) * (self.onto - self.gram @ design @ fitted)
        freedom = max(len(here) - design.shape[1], 1)
        variance = inverse[0, 0] + (pulls**2).sum() * len(here) / freedom
        return Contrast(float(fitted[0]), float(np.sqrt(variance)), freedom)

    def typical(self, alike: Contrast, here: np.ndarray, off: float) -> Contrast:
        """Fit the mean of amounts that differ from episode to episode (random effects; DerSimonian & Laird 1986).

        An engine responds too strongly in one motion and too weakly in another: of motions of which much is known, one
        that is off would decide alone.

        Args:
            alike: The amount where all episodes have the same.
            here: Which episodes are to be explained, bool [E].
            off: Standard deviation of an episode's amount, as a share of the mean.
        """
        found = alike
        for _ in range(_ROUNDS):
            if found.amount > 0:
                found = self.contrast(here, off * found.amount)
        return found

    def _normal(self, here: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Give the design of a and, where some episodes are a reference, s, [E, 1 or 2], and its normal matrix."""
        z = here.astype(float)
        design = z[:, None] if here.all() else np.stack([z, np.ones(len(z))], 1)
        return design, design.T @ self.gram @ design

    def held_out(self, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Predict each episode, of the reference, too, with the amounts that all others show.

        The hypothesis stands against the same without a, so that what is in the reference, too, is no gain.

        Args:
            labels: Which episodes are to be explained, 0 or 1, [N, E]; N ways of dealing them out.

        Returns:
            Gain of log density [nats], and the a that the others show in an episode to explain, 0 where it is negative;
            [N, E] each.
        """
        z, alone = labels, bool((labels > 0).all())
        row, pulled, own = self.gram.sum(1), labels @ self.gram, np.diag(self.gram)
        nothing = _SINGULAR * max(float(own.sum()), 1e-300)
        own = np.where(own > nothing, own, np.inf)
        # [N, E]: products of s and a with each other and with the residuals, an episode not being there: its part of
        # the covariance is taken out (Schur's complement)
        aa, a = (pulled * z).sum(1)[:, None] - pulled**2 / own, (z @ self.onto)[:, None] - pulled * self.onto / own
        sa, s = (z @ row)[:, None] - pulled * row / own, self.onto.sum() - row * self.onto / own
        ss = row.sum() - row**2 / own
        ss = np.where((ss > nothing) & (not alone), ss, np.inf)
        volume = aa - sa**2 / ss
        usable = volume > nothing
        amount = np.where(usable, np.maximum((a - sa * s / ss) / np.where(usable, volume, 1.0), 0.0), 0.0)
        # log density of the amount in an episode, all others given, over that without a
        left = [self.onto - (s - sa * each) / ss * row - each * pulled for each in (0.0 * amount, amount)]
        gains = 0.5 * (left[0] ** 2 - left[1] ** 2) / own
        return gains, amount * z

    def strength(self, labels: np.ndarray) -> np.ndarray:
        """Sum of the roots of the gains of all episodes, for N ways of dealing them out, [N]: what ranks and is tested.

        Those of the reference count as well: without a, what the others show of the law is expected in it, too.
        """
        return np.asarray(roots(self.held_out(labels)[0]).sum(1))

    def with_amount(self, change: float, here: np.ndarray) -> Products:
        """Give what the evidence would say with so much more of the law in the episodes to explain."""
        return Products(self.gram, self.onto + change * self.gram @ here.astype(float))


def own_amounts(gram: np.ndarray, onto: np.ndarray, here: np.ndarray) -> np.ndarray:
    """Fit how much each episode to explain shows of several responses by itself, beyond what all episodes show.

    The responses are those of one law in all its settings: what a law does is in proportion to none of them where it is
    strong, or where the engine errs from motion to motion. They resemble each other, and there are as many amounts as
    episodes, so that all have a normal prior with the amplitude at which a response was computed as its scale (ridge
    regression).

    Args:
        gram: Products of K responses, [E, K, E, K].
        onto: Products with the residuals, [E, K].
        here: Which episodes are to be explained, bool [E].

    Returns:
        Amounts, [E, K]; 0 in the reference.
    """
    (count, wide), each = onto.shape, np.flatnonzero(here)
    # [E, X]: the amounts of every episode to explain, then, where there is a reference, what is in all of them
    common = np.zeros((count, 0)) if here.all() else np.ones((count, 1))
    design = np.kron(np.concatenate([np.eye(count)[:, each], common], 1), np.eye(wide))
    normal = design.T @ gram.reshape(count * wide, count * wide) @ design
    fitted = np.linalg.solve(normal + np.eye(len(normal)), design.T @ onto.reshape(-1))
    found = np.zeros((count, wide))
    found[each] = fitted[: len(each) * wide].reshape(-1, wide)
    return found


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
