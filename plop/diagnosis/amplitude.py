"""How well an amplitude is known: what differs between episodes, what the engine gets wrong, what saturation hides.

A law whose response hardly grows any more with its amplitude leaves that amplitude open: where the response grows as
amplitude^p, a response that is 10 % off means an amplitude that is about 10 % / p off (the delta method).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from plop.diagnosis.candidates import Column

RESPONSE_ERROR = 0.2
"""Standard deviation of how much too strongly or too weakly the engine responds to a law [-]: the same in all
episodes, so that no scatter between them tells. Measured where the truth is known: docs/results-physics.md."""
GROWTH_LIMITS = 0.1, 2.0


def growth_of(full: Sequence[np.ndarray], half: Sequence[np.ndarray]) -> float:
    """Find p of response ~ amplitude^p between half of an amplitude and all of it.

    Args:
        full: Responses at the amplitude, one array an episode [m].
        half: Responses at half of it [m].
    """
    square = sum(float((a * a).sum()) for a in full)
    shared = sum(float((a * b).sum()) for a, b in zip(full, half, strict=True))
    if square <= 0 or shared <= 0:
        return GROWTH_LIMITS[1 if shared <= 0 < square else 0]
    return float(np.clip(np.log2(square / shared), *GROWTH_LIMITS))


def amplitude_of(column: Column, value: float, error: float, episodes: int, growth: float = 1.0) -> dict[str, Any]:
    """Give a fitted amplitude with its 95 % interval, kept inside the range of the parameter.

    Args:
        column: What was fitted.
        value: Fitted amplitude.
        error: Its standard error over episodes.
        episodes: How many there are.
        growth: Exponent p of the response near this amplitude.

    Returns:
        {"value", "low", "high", "unit", "at_bound"}; an amplitude that cannot be told has an infinite interval.
    """
    at_bound = value >= column.high or value <= column.low and column.low != 0
    by_chance = student.ppf(0.975, max(episodes - 1, 1)) * error
    if value == 0 or not np.isfinite(by_chance):
        low, high = value - by_chance, value + by_chance
    else:
        width = float(np.hypot(by_chance / abs(value), norm.ppf(0.975) * RESPONSE_ERROR))
        # Beyond a whole response there is no saturation to speak of: the law may as well have the other sign.
        least = (1 - width) ** (1 / growth) if width < 1 else 1 - width
        low, high = sorted((value * least, value * (1 + width) ** (1 / growth)))
        low, high = (float(np.clip(end, column.low, column.high)) for end in (low, high))
    return {"value": float(np.clip(value, column.low, column.high)), "low": float(low), "high": float(high),
            "unit": column.unit, "at_bound": bool(at_bound or value < column.low)}  # fmt: skip
