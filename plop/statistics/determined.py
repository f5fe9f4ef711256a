"""Whether recordings tell a fitted number at all: one rule for every table, page and warning.

A number is *not determined* where the fit ran into its allowed range, where an end of its 95 % interval is not known,
or where the interval says hardly more than the range did before anything was measured: it covers half of the range, or
a factor of ten of a number of which only the order of magnitude is in question (a stiffness, the strength of a law).
Half and ten are conventions: beyond them what was allowed has not even been halved, or its order of magnitude is open.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, log
from typing import Any

NOT_DETERMINED = "not determined by these recordings"
"""What is said of such a number, everywhere."""
OPEN_SHARE, OPEN_FACTOR = 0.5, 10.0
"""Width of an interval that says hardly anything: share of the range, or a factor of a number that is scaled."""
WIDE_RANGE = 100.0
"""A range that reaches so many times its smallest step bounds hardly anything: half of it would be far too much."""
CHANGED_LOGARITHM = "d_ln_"
"""How the name of a number begins that is the change of a logarithm: its range is one of factors already."""


@dataclass(frozen=True)
class Allowed:
    """The range of a number, as the engine or an effect declares it."""

    low: float
    high: float
    step: float = 0.0
    """A fitted amplitude below it is as good as absent; 0 where that is not known."""
    logarithmic: bool = False
    """Its logarithm is fitted."""
    tried: int = 0
    """How many values were tried of a setting that is chosen, not fitted."""


def determined(name: str, found: Mapping[str, Any], allowed: Allowed | None = None) -> bool:
    """Tell whether the recordings say what a number is.

    Args:
        name: Of the number.
        found: {"value", "low", "high", "at_bound"}, an unknown end infinite, None or absent; for a setting that is
            chosen from a few values {"chosen": True, "also": those that do as well}, which is determined where these
            are at most half of what was tried.
        allowed: Its range; without it only bounds and unknown ends tell.
    """
    if found.get("chosen") or found.get("also"):
        as_good = 1 + len(found.get("also") or ())
        return as_good == 1 or (allowed is not None and 2 * as_good <= allowed.tried)
    low, high = found.get("low"), found.get("high")
    if found.get("at_bound") or low is None or high is None or not (isfinite(low) and isfinite(high)):
        return False
    return allowed is None or not _open(name, float(low), float(high), allowed)


def _open(name: str, low: float, high: float, allowed: Allowed) -> bool:
    low, high = max(low, allowed.low), min(high, allowed.high)
    if name.startswith(CHANGED_LOGARITHM):
        return high - low > log(OPEN_FACTOR)
    if allowed.logarithmic:
        return high > OPEN_FACTOR * low
    if high - low > OPEN_SHARE * (allowed.high - allowed.low):
        return True
    # of an amplitude, which is 0 where the law is absent, the size counts, whatever its sign
    smallest = 0.0 if low < 0 < high else min(abs(low), abs(high))
    largest = max(abs(low), abs(high))
    wide = allowed.step > 0 and max(abs(allowed.low), abs(allowed.high)) >= WIDE_RANGE * allowed.step
    return wide and max(largest, allowed.step) > OPEN_FACTOR * max(smallest, allowed.step)
