"""How large the base's error is, here and where nothing is missing, and whether the difference is chance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

EXCESS_LEAST = 3.0
"""Standard errors by which the error must exceed the reference's for something to be wrong."""
EXCESS_P = 0.005
"""Or the chance that dealing the episodes out anew makes the difference in mean error as large: a law that only some
motions show makes a few episodes very wrong and leaves the others, which standard errors take for scatter."""
EXCESS_RATIO = 1.5
"""And the least ratio of the two errors."""
DEALS = 4000


@dataclass(frozen=True)
class ErrorSize:
    """Mean squared whitened errors over episodes; without reference the last three are None."""

    error: float
    """Of the base with its own parameters refitted."""
    raw: float
    """Of the base as it is."""
    floor: float | None = None
    """In the reference recordings."""
    excess: float | None = None
    """How much larger the error is than in the reference, in standard errors (Welch, of logarithms)."""
    excess_p: float | None = None
    """The same as a chance, by permutation."""

    @classmethod
    def of(cls, ours: np.ndarray, raw: float, theirs: np.ndarray) -> ErrorSize:
        """Compare the errors of the episodes [E] with those of the reference [R], which may be few or none."""
        error, floor = float(ours.mean()), float(theirs.mean()) if len(theirs) else None
        if len(theirs) < 2:
            return cls(error, raw, floor)
        logs = np.log(ours), np.log(theirs)
        spread = np.sqrt(sum(values.var(ddof=1) / len(values) for values in logs))
        excess = float((logs[0].mean() - logs[1].mean()) / max(spread, 1e-12))
        return cls(error, raw, floor, excess, exchanged(ours, theirs))

    @property
    def beyond_chance(self) -> bool:
        """Tell whether the error exceeds the reference's by its standard errors."""
        return self.excess is not None and self.excess > EXCESS_LEAST

    @property
    def stands_out(self) -> bool:
        """Tell whether the error by itself shows that something is missing, whatever that is."""
        beyond = self.beyond_chance or (self.excess_p is not None and self.excess_p <= EXCESS_P)
        return self.floor is not None and beyond and self.error > EXCESS_RATIO * self.floor

    def closed(self, left: float | None) -> float | None:
        """Share of the explainable gap that a law closes which leaves so much; None when it is not known."""
        return _closed(self.error, left, self.floor)

    @property
    def closed_by_base(self) -> float | None:
        """The same for a change of the base's own parameters."""
        return _closed(self.raw, self.error, self.floor)


def _closed(error: float, left: float | None, floor: float | None) -> float | None:
    if floor is None or left is None or error <= floor:
        return None
    return (error - left) / (error - floor)


def exchanged(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Permutation test of mean(ours) > mean(theirs) (Fisher 1935): (1 + deals with as large a sum) / (1 + deals)."""
    both, count = np.concatenate([ours, theirs]), len(ours)
    order = np.argsort(np.random.default_rng(0).random((DEALS, len(both))), axis=1)[:, :count]
    dealt = both[order].sum(1)
    return float((1 + (dealt >= ours.sum() * (1 - 1e-12)).sum()) / (1 + DEALS))
