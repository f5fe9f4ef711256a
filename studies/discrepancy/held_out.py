"""How much better each hypothesis predicts an episode from all others: expected log predictive density, left out.

A hypothesis is a list of settings: amplitudes on a grid, for every variant of a law. At each setting the response is a
mixture of runs ("knots"), and the engine's own response may be off by a share in each quarter of the motion. The
amplitude is never fitted to the episode that is scored: settings are weighted by what the other episodes say of them
(Vehtari, Gelman & Gabry 2017).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from discrepancy import Evidences, Field, LeftOut

QUARTERS = 4
CONTRAST = True
"""Parts of a motion in each of which the engine's response may be off by a share of its own."""
_RESPONSE_ERROR = 0.3
"""Standard deviation of that share [-]: what two discretisations of the engine differ by (cosine 0.85 to 0.95)."""


@dataclass(frozen=True)
class Setting:
    """One value of a hypothesis."""

    candidate: str
    """Key of the law's variant, e.g. "fibres(angle_deg=45)"."""
    multiples: tuple[float, ...]
    """Amplitudes in the recordings, in units of the columns' typical ones."""
    before: float
    """The same for all episodes, the references too: a base parameter that is refitted; 0 elsewhere."""
    here: tuple[tuple[int, float], ...]
    """Knots and their weights in the episodes to explain: the difference to `everywhere`."""
    everywhere: tuple[tuple[int, float], ...] = ()
    """Knots and their weights in all episodes."""


@dataclass(frozen=True)
class Score:
    """How a hypothesis did."""

    law: str
    gain: np.ndarray
    """Gain of log predictive density over the null hypothesis, by left-out episode, [T]."""
    settings: tuple[Setting, ...]
    posterior: np.ndarray
    """Probability of each setting given all episodes, [S]."""

    @property
    def total(self) -> float:
        """Gain over all episodes."""
        return float(self.gain.sum())

    @property
    def error(self) -> float:
        """Standard error of the total, over episodes."""
        return float(np.std(self.gain, ddof=1) * np.sqrt(len(self.gain)))

    @property
    def best(self) -> Setting:
        """The most probable setting."""
        return self.settings[int(np.argmax(self.posterior))]


def hats(phase: np.ndarray) -> np.ndarray:
    """Divide a motion into overlapping parts that add up to one, [F] -> [F, QUARTERS]."""
    return np.clip(1 - np.abs(phase[:, None] - np.linspace(0, 1, QUARTERS)) * (QUARTERS - 1), 0, 1)


class HeldOut:
    """Products of residuals and responses with the inverse covariance, from which every hypothesis is scored."""

    def __init__(
        self, evidences: Evidences, field: Field, residuals: Sequence[np.ndarray], knots: int, shared: Sequence[int]
    ) -> None:
        """Multiply out once.

        Args:
            evidences: The episodes.
            field: The discrepancy model.
            residuals: [3 F K] for each episode.
            knots: Number of knots A.
            shared: Knots that may act in all episodes.
        """
        self.knots, self.shared = knots, {k: knots + i for i, k in enumerate(shared)}
        columns = []
        for episode, residual in zip(evidences.episodes, residuals, strict=True):
            here = episode.responses if episode.explained else np.zeros_like(episode.responses)
            both = np.concatenate([here, episode.responses[..., list(shared)]], -1)
            parts = both[..., None] * hats(episode.phase)[:, None, None, None, :]
            columns.append(np.concatenate([residual[:, None], parts.reshape(len(residual), -1)], 1))
        applied, _, _ = field.apply(columns)
        self.left: list[LeftOut] = [field.left_out(k, applied) for k, e in enumerate(evidences.episodes) if e.explained]

    def densities(self, settings: Sequence[Setting]) -> np.ndarray:
        """Log density of each left-out episode at each setting, up to what all settings share, [T, S]."""
        count = self.knots + len(self.shared)
        weights = np.zeros((len(settings), count))
        for row, setting in zip(weights, settings, strict=True):
            for knot, weight in setting.here:
                row[knot] += weight
            for knot, weight in setting.everywhere:
                row[self.shared[knot]] += weight
        used = np.flatnonzero(np.abs(weights).sum(0))
        return np.stack([_density(one.gram, weights[:, used], used, count) for one in self.left])

    @property
    def absolute(self) -> np.ndarray:
        """Log density of each left-out episode without any hypothesis, constants aside, [T]."""
        return np.array([-0.5 * (one.gram[0, 0] + one.spread) for one in self.left])


def _density(gram: np.ndarray, weights: np.ndarray, used: np.ndarray, count: int) -> np.ndarray:
    """Integrate the response's own error out; see `HeldOut.densities`."""
    size = len(weights)
    own = gram[0, 1:].reshape(count, QUARTERS)[used]
    inner = gram[1:, 1:].reshape(count, QUARTERS, count, QUARTERS)[used][:, :, used]
    onto = weights @ own
    half = np.tensordot(weights, inner, 1)  # S, Q, used, Q
    products = np.einsum("sqar,sa->sqr", half, weights) if len(used) else np.zeros((size, QUARTERS, QUARTERS))
    squares = gram[0, 0] - 2 * onto.sum(1) + products.sum((1, 2))
    error = onto - products.sum(2)
    share = _RESPONSE_ERROR**2
    solved = np.linalg.solve(np.eye(QUARTERS) / share + products, error[..., None])[..., 0]
    volume = np.linalg.slogdet(np.eye(QUARTERS) + share * products)[1]
    if CONTRAST:
        without = np.linalg.solve(np.eye(QUARTERS) / share + products, onto[..., None])[..., 0]
        return np.asarray(-0.5 * (squares - (error * solved).sum(1)) + 0.5 * (gram[0, 0] - (onto * without).sum(1)) - 0.5 * gram[0, 0])
    return np.asarray(-0.5 * (squares - (error * solved).sum(1) + volume))


def predictive(densities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average over settings, each weighted by what the other episodes say of it.

    Args:
        densities: [T, S].

    Returns:
        Log predictive density of each left-out episode [T], and the settings' posterior probabilities [S].
    """
    total = densities.sum(0)
    others = total - densities
    found = logsumexp(total) - logsumexp(others, axis=1)
    return found, np.exp(total - logsumexp(total))


def score(held: HeldOut, laws: Mapping[str, Sequence[Setting]], null: Sequence[Setting]) -> tuple[list[Score], np.ndarray]:
    """Score every law against the null hypothesis.

    Args:
        held: The evidence.
        laws: Settings of each.
        null: Settings of the null hypothesis: the base's own parameters refitted, nothing else.

    Returns:
        Scores, best first; log predictive density of each left-out episode under the null hypothesis [T].
    """
    plain, posterior = predictive(held.densities(null))
    refit = null[int(np.argmax(posterior))]
    found = []
    for law, settings in laws.items():
        moved = [s if s.everywhere or s.before else _with_refit(s, refit) for s in settings]
        gained, chance = predictive(held.densities(moved))
        found.append(Score(law, gained - plain, tuple(moved), chance))
    return sorted(found, key=lambda s: -s.total), plain


def _with_refit(setting: Setting, refit: Setting) -> Setting:
    return Setting(setting.candidate, setting.multiples, setting.before, setting.here, refit.everywhere)
