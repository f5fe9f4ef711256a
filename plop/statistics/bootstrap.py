"""Bootstrap interval of a mean over episodes.

Episodes are the independent units (frames of one episode are not), so episodes are drawn
with replacement and the interval contains the middle 95 % of the resampled means. With two
episodes the resampled means have only three values and the interval is the smaller and the
larger one; with one episode there is no interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Interval:
    """Mean with its bootstrap interval, in the unit of the values."""

    mean: float
    low: float | None
    """2.5 % quantile of the resampled means; None with fewer than two episodes."""
    high: float | None
    """97.5 % quantile."""
    n: int
    """Number of episodes."""


def bootstrap_interval(values: Sequence[float | None], *, seed: int = 0, draws: int = 2000) -> Interval | None:
    """Average values over episodes, with a bootstrap interval of the mean.

    Args:
        values: One value per episode; None is left out.
        seed: Seed of the resampling.
        draws: Number of resampled means.

    Returns:
        The interval, or None when no episode has a value.
    """
    known = np.array([value for value in values if value is not None], dtype=np.float64)
    if len(known) == 0:
        return None
    if len(known) == 1:
        return Interval(float(known[0]), None, None, 1)
    chosen = np.random.default_rng(seed).integers(len(known), size=(draws, len(known)))
    low, high = np.quantile(known[chosen].mean(axis=1), [0.025, 0.975])
    return Interval(float(known.mean()), float(low), float(high), len(known))
