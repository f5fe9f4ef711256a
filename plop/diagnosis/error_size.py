"""How large the base's error is, here and where nothing is missing, and whether the difference is chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from plop.diagnosis.strata import strata_of, told_apart

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
    """Of the base with its own parameters refitted, or as it is where that is less."""
    raw: float
    """Of the base as it is."""
    floor: float | None = None
    """In the reference recordings."""
    excess: float | None = None
    """How much larger the error is than in the reference, in standard errors (Welch, of logarithms)."""
    excess_p: float | None = None
    """The same as a chance, by permutation, and within kinds of motion where these can be told apart."""

    @classmethod
    def of(
        cls, ours: np.ndarray, raw: float, theirs: np.ndarray, kinds: tuple[Sequence[str], Sequence[str]] = ((), ())
    ) -> ErrorSize:
        """Compare the errors of the episodes [E] with those of the reference [R], which may be few or none.

        Args:
            ours: Mean squared errors, see `error`.
            raw: The mean without refitting.
            theirs: The reference's.
            kinds: Kind of motion of every episode, here and in the reference.
        """
        error, floor = float(ours.mean()), float(theirs.mean()) if len(theirs) else None
        if len(theirs) < 2:
            return cls(error, raw, floor)
        logs = np.log(ours), np.log(theirs)
        spread = np.sqrt(sum(values.var(ddof=1) / len(values) for values in logs))
        excess = float((logs[0].mean() - logs[1].mean()) / max(spread, 1e-12))
        p = exchanged(ours, theirs)
        strata = strata_of(*kinds)
        if told_apart(strata):
            p = min(1.0, 2 * min(p, exceeded_within(*logs, *strata)))
        return cls(error, raw, floor, excess, p)

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


def exceeded_within(ours: np.ndarray, theirs: np.ndarray, kinds: Sequence[str], their_kinds: Sequence[str]) -> float:
    """Chance that some kind of motion exceeds the reference's by as much, when nothing differs (t test, Bonferroni).

    The scatter is pooled over the kinds of both sets: two or three episodes of a kind do not tell theirs.

    Args:
        ours: Logarithms of the errors, [E].
        theirs: Those of the reference, [R].
        kinds: Kind of motion of every episode; each is among `their_kinds`.
        their_kinds: Those of the reference.
    """
    squares, degrees, found = 0.0, 0, []
    for kind in dict.fromkeys(kinds):
        parts = [values[np.array(labels) == kind] for values, labels in ((ours, kinds), (theirs, their_kinds))]
        squares += sum(float(((part - part.mean()) ** 2).sum()) for part in parts)
        degrees += sum(len(part) - 1 for part in parts)
        found.append((parts[0].mean() - parts[1].mean()) / np.sqrt(sum(1 / len(part) for part in parts)))
    scatter = max(np.sqrt(squares / max(degrees, 1)), 1e-12)
    return float(min(1.0, len(found) * student.sf(max(found) / scatter, max(degrees, 1))))
