"""Is there more of a law in the recordings than in the reference? Asked for any way of dealing the episodes out.

In episode e a hypothesis changes residuals by R_e times an amount. With the inverse covariance P of the discrepancy
model, everything that can be asked of it stands in the products

    G[e, f] = R_e' P_ef R_f        g[e] = sum_f R_e' P_ef r_f

of E by E and E numbers. Amounts are s in all episodes (what the base lacks there, too) and s + a in those to explain,
z = 1; without a reference s is 0. Amounts are in units of the amplitude at which the response was computed, so that a
law that is there at that amplitude has a = 1; only a > 0 counts, since the other way is another hypothesis.

An engine responds too strongly in one motion and too weakly in another, by a share q (`DecisionRule.response_error`):
amounts scatter between motions by q times their mean (random effects), and not between repeats of one. So motions in
which much moves do not decide alone, and where the response is wrong in one of them, the others speak:

    g ~ N(G (s + a z), G + G T G)        T[e, f] = q^2 (s + a z_e) (s + a z_f) where e and f repeat a motion, else 0
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.diagnosis.evidence.amounts import SINGULAR, Contrast, typical
from plop.diagnosis.rule import RULE
from plop.statistics.heavy_tails import FREEDOM


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
    repeats: np.ndarray | None = None
    """1 where two episodes repeat a motion, else 0, [E, E]; absent: none does."""

    @property
    def freedom(self) -> float:
        """Degrees of freedom with which the scale of a strength is known where nothing is hidden.

        Those are the episodes that tell something of the hypothesis, less s and a, and no fewer than those of the
        scale that all episodes share. A strength is a sum of roots: episodes are counted (Kish's effective number) by
        the root of how much each tells.
        """
        told = np.sqrt(np.diag(self.gram))
        return max(float(told.sum() ** 2 / max((told**2).sum(), 1e-300)) - 2.0, FREEDOM)

    def typical(self, here: np.ndarray) -> Contrast:
        """Fit the mean of amounts that scatter in proportion to it; see `typical`."""
        return typical(self.gram[:, None, :, None], self.onto[:, None], here, self._repeats)

    @property
    def _repeats(self) -> np.ndarray:
        return np.eye(len(self.onto)) if self.repeats is None else self.repeats

    def held_out(self, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Predict each episode, of the reference, too, with the amounts that all others show.

        The hypothesis stands against the same without a, where s is the same in all episodes: what is in the reference,
        too, is no gain. Amounts are fitted as if they scattered as those of a law at a = 1.

        Args:
            labels: Which episodes are to be explained, 0 or 1, [N, E]; N ways of dealing them out.

        Returns:
            Gain of log density [nats], and the a that the others show in an episode to explain, 0 where it is negative;
            [N, E] each.
        """
        off, size = RULE.response_error, len(self.onto)
        unlike = np.linalg.inv(np.eye(size) + off**2 * self.gram @ self._repeats)
        gram, onto = unlike @ self.gram, unlike @ self.onto
        amount, shared, _ = _fitted(gram, onto, labels, self._own(gram))
        of_law, of_all, _ = (each[:, :1] for each in _fitted(gram, onto, labels, np.full(size, np.inf)))
        return self._gains(labels, shared, amount, off * (of_all + of_law * labels)), amount * labels

    def strength(self, labels: np.ndarray) -> np.ndarray:
        """Sum of the roots of the gains of all episodes, for N ways of dealing them out, [N]: what is tested.

        Here amounts are the same in all episodes: that they scatter explains what a base misses, too, so that chance
        would find more. Episodes of the reference count as well: without a, what the others show of the law is expected
        in them, too.
        """
        amount, shared, _ = _fitted(self.gram, self.onto, labels, self._own(self.gram))
        return np.asarray(roots(self._gains(labels, shared, amount, np.zeros((1, 1)))).sum(1))

    def _gains(self, labels: np.ndarray, shared: np.ndarray, amount: np.ndarray, scatter: np.ndarray) -> np.ndarray:
        """Compare what s and a say of each episode with what one s says, the same in all; see `_log_density`."""
        alike = _fitted(self.gram, self.onto, labels, self._own(self.gram))[2]
        without = self._log_density(alike, 0.0 * amount, labels, np.zeros((1, 1)))
        gains = self._log_density(shared, amount, labels, scatter) - without
        return np.where(self._tells & (amount > 0), gains, 0.0)

    @property
    def _tells(self) -> np.ndarray:
        """Which episodes tell anything of the hypothesis, bool [E]."""
        own = np.diag(self.gram)
        return np.asarray(own > SINGULAR * max(float(own.sum()), 1e-300))

    def _own(self, gram: np.ndarray) -> np.ndarray:
        """What each episode tells by itself, infinite where it is nothing, so that nothing is left out, [E]."""
        return np.where(self._tells, np.diag(gram), np.inf)

    def _log_density(
        self, shared: np.ndarray, amount: np.ndarray, labels: np.ndarray, scatter: np.ndarray
    ) -> np.ndarray:
        """Give the log density of each episode, all others given, [N, E].

        Args:
            shared: s, by which each is predicted, [N, E].
            amount: a, [N, E].
            labels: Which episodes are to be explained, [N, E].
            scatter: Standard deviation of the amount of an episode, but for repeats of its motion, [N or 1, E or 1].
        """
        size, ways = len(self.onto), len(labels)
        inverse = np.linalg.inv(np.eye(size) + self.gram @ (scatter[:, :, None] * self._repeats * scatter[:, None, :]))
        seen = np.maximum(np.einsum("nef,fe->ne", inverse, self.gram), 1e-300)
        of_law = np.einsum("nef,nf->ne", np.broadcast_to(inverse @ self.gram, (ways, size, size)), labels)
        left = inverse @ self.onto - shared * (inverse @ self.gram.sum(1)) - amount * of_law
        return np.asarray(0.5 * (np.log(seen) - left**2 / seen))

    def with_amount(self, change: float, here: np.ndarray) -> Products:
        """Give what the evidence would say with so much more of the law in the episodes to explain."""
        return Products(self.gram, self.onto + change * self.gram @ here.astype(float), self.repeats)


def _fitted(
    gram: np.ndarray, onto: np.ndarray, labels: np.ndarray, own: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit amounts to all episodes but one, for each of them.

    Args:
        gram: Products of a response, [E, E].
        onto: Products with the residuals, [E].
        labels: Which episodes are to be explained, [N, E].
        own: What each episode tells by itself, [E]; infinite: it is not left out.

    Returns:
        a, 0 where it is negative, s, and s without a; [N, E] each.
    """
    z, alone = labels, bool((labels > 0).all())
    row, pulled = gram.sum(1), labels @ gram
    nothing = SINGULAR * max(float(np.diag(gram).sum()), 1e-300)
    # [N, E]: products of s and a with each other and with the residuals, an episode not being there: its part of the
    # covariance is taken out (Schur's complement)
    aa, a = (pulled * z).sum(1)[:, None] - pulled**2 / own, (z @ onto)[:, None] - pulled * onto / own
    sa, s = (z @ row)[:, None] - pulled * row / own, onto.sum() - row * onto / own
    ss = row.sum() - row**2 / own
    ss = np.where((ss > nothing) & (not alone), ss, np.inf)
    volume = aa - sa**2 / ss
    usable = volume > nothing
    amount = np.where(usable, np.maximum((a - sa * s / ss) / np.where(usable, volume, 1.0), 0.0), 0.0)
    return amount, (s - sa * amount) / ss, np.broadcast_to(s / ss, amount.shape)
