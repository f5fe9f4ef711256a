"""What the evidence says of one hypothesis, and the best of several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plop.diagnosis.evidence.amounts import Contrast
from plop.diagnosis.evidence.contrast import Products, roots
from plop.diagnosis.responses.hypotheses import Hypothesis

_AS_GOOD = 0.02
"""Share of its strength by which a law may differ between amplitudes at which it does as well."""


@dataclass(frozen=True)
class Score:
    """What the evidence says of one hypothesis."""

    hypothesis: Hypothesis
    products: Products
    amount: float
    """Mean over episodes, in units of the hypothesis's amplitudes; 0 where the recordings ask for the other way."""
    direct: Callable[[], Contrast]
    """Computes `directed`."""
    p: float
    """Chance that the search finds a law as strong as this one where nothing is hidden; see `Search.chance_of`."""
    gains: np.ndarray
    """Gain of log density of each episode, held out, those to explain first, then the reference, [E] [nats]."""
    recordings: int
    """How many are to be explained, H."""
    size_m: float
    """RMS displacement that the law makes [m]."""
    explain: Callable[[], tuple[np.ndarray, np.ndarray]]
    """Computes `explained`: few of all scores are asked for it."""

    @cached_property
    def explained(self) -> tuple[np.ndarray, np.ndarray]:
        """Squared error of each episode to explain, in units of its expectation, [H] each.

        Without the law, the base refitted beside it; and how much of that goes away, held out.
        """
        return self.explain()

    @cached_property
    def directed(self) -> Contrast:
        """Amount with its standard error; of a law with two amplitudes, along the hypothesis's direction and across."""
        return self.direct()

    @property
    def recorded(self) -> np.ndarray:
        """Gains of the episodes to explain, [H] [nats]."""
        return self.gains[: self.recordings]

    @property
    def strength(self) -> float:
        """Sum of the roots of the gains: what ranks; see `Products.strength` for what is tested."""
        return float(roots(self.gains).sum())

    @property
    def values(self) -> tuple[float, ...]:
        """Fitted amplitudes."""
        if self.amount == 0:
            return tuple(0.0 * value for value in self.hypothesis.values)
        return tuple(map(float, self._axes @ self.directed.amounts))

    @property
    def errors(self) -> np.ndarray:
        """Their standard errors."""
        return np.asarray(np.sqrt(np.diag(self._axes @ self.directed.covariance @ self._axes.T)))

    @property
    def _axes(self) -> np.ndarray:
        """Amplitudes of the hypothesis and, where both are known, those across, a column each."""
        along = np.array(self.hypothesis.values)
        return along[:, None] if len(self.directed.amounts) == 1 else np.array([along, [-along[1], along[0]]]).T


def one_per_setting(scores: Sequence[Score]) -> list[Score]:
    """Keep the best score of every law in every setting of its shape, the strongest first.

    Of amplitudes that do as well, the one nearest to where the response was computed is kept: there the response is
    known, elsewhere it is only taken to be in proportion.
    """
    found: dict[str, list[Score]] = {}
    for score in scores:
        found.setdefault(score.hypothesis.candidate.key, []).append(score)
    kept = []
    for own in found.values():
        good = [s for s in own if s.amount > 0 and s.strength >= (1 - _AS_GOOD) * own[0].strength]
        kept.append(min(good, key=lambda s: abs(np.log(s.amount)), default=own[0]))
    return sorted(kept, key=lambda s: -s.strength)


def one_per_law(scores: Sequence[Score]) -> list[Score]:
    """Keep the best score of every law."""
    best: dict[str, Score] = {}
    for score in one_per_setting(scores):
        best.setdefault(score.hypothesis.effect, score)
    return list(best.values())
