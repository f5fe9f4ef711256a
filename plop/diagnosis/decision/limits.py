"""Detection limits: how large must a law's effect be to be named in these very recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from plop.diagnosis.rule import RULE, DecisionRule

if TYPE_CHECKING:
    from plop.diagnosis.evidence.contrast import Products
    from plop.diagnosis.responses.hypotheses import Column
    from plop.diagnosis.scores.score import Score
    from plop.diagnosis.scores.search import Search

_PRECISION = 1e-6
"""Relative, of a multiple that is just seen: far below what draws of noise change it by."""


@dataclass(frozen=True)
class Limit:
    """Smallest amplitude of a law that would have been named."""

    amplitude: float | None
    """None where none in its range would be."""
    unit: str
    parameter: str
    displacement_m: float | None
    """RMS displacement that it makes [m]."""


def detection_limits(search: Search, scores: Sequence[Score], rule: DecisionRule = RULE) -> dict[str, Limit]:
    """Give the amplitude of each law that would exceed what chance finds, nine times in ten.

    Args:
        search: The evidence.
        scores: One for each law.
        rule: Error rates.
    """
    if search.here.all():
        return {score.hypothesis.effect: unseen(score.hypothesis.candidate.columns[0]) for score in scores}
    certain = search.difference.p is not None and search.difference.p <= rule.alarm
    level, found = rule.alike if certain else rule.alarm, {}  # as the decision is made
    for score in scores:
        hypothesis = score.hypothesis
        column, value = max(
            zip(hypothesis.candidate.columns, hypothesis.values, strict=True), key=lambda pair: abs(pair[1])
        )
        critical = search.critical(level, hypothesis.effect)
        without = score.products.with_amount(-score.amount, search.here)
        multiple = least_seen(without, search.here, critical, hypothesis.most)
        multiple += float(norm.ppf(rule.seen)) * score.directed.error
        if not multiple <= hypothesis.most:
            found[hypothesis.effect] = unseen(column)
            continue
        size = search.size_m(hypothesis) * multiple
        found[hypothesis.effect] = Limit(multiple * value, column.unit, column.amplitude, size)
    return found


def least_seen(without: Products, here: np.ndarray, critical: float, most: float) -> float:
    """Inject a law into evidence without it, and find the least multiple that passes; infinite if none does.

    Args:
        without: What the evidence says of the law where it is not there.
        here: Which episodes are to be explained, bool [E].
        critical: Strength that it must have.
        most: Largest multiple in its range.
    """
    labels = here[None].astype(float)

    def beyond(multiple: float) -> float:
        return float(without.with_amount(multiple, here).strength(labels)[0]) - critical

    if beyond(most) < 0:
        return float("inf")
    return 0.0 if beyond(0.0) >= 0 else float(brentq(beyond, 0.0, most, rtol=_PRECISION))


def unseen(column: Column) -> Limit:
    """Give the limit of a law of which no amplitude in its range would be named."""
    return Limit(None, column.unit, column.amplitude, None)
