"""A number of a law or of a material, from its declaration (`Parameter`) to what recordings say of it (`Estimate`).

An estimate is *not determined* where the fit ran into its allowed range, where an end of its 95 % interval is not
known, or where the interval says hardly more than the range did before anything was measured: it covers half of the
range, or a factor of ten of a number of which only the order of magnitude is in question (a stiffness, the strength of
a law). Half and ten are conventions: beyond them what was allowed has not even been halved, or its order of magnitude
is open.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from plop.errors import PlopError
from plop.finite import UNKNOWN, json_ready

NOT_DETERMINED = "not determined by these recordings"
"""What is said of such a number, everywhere."""
OPEN_SHARE, OPEN_FACTOR = 0.5, 10.0
"""Width of an interval that says hardly anything: share of the range, or a factor of a number that is scaled."""
WIDE_RANGE = 100.0
"""A range that reaches so many times its smallest step bounds hardly anything: half of it would be far too much."""


@dataclass(frozen=True)
class Parameter:
    """One number of a law, of a material or of a sensor's fault, as it is declared."""

    name: str
    unit: str
    low: float
    """Least value that makes sense."""
    high: float
    """Largest value that makes sense."""
    step: float
    """Finite difference at which the response is still linear, on the scale of the fit; 0 for a shape parameter."""
    default: float = 0.0
    """Value when nothing is given; 0 means 'absent' for an amplitude."""
    typical: float = 0.0
    """An amplitude at which the effect is plainly there; where to start when a signal of given size is wanted."""
    help: str = ""
    tried: tuple[float, ...] = ()
    """Further amplitudes, of either sign, at which a diagnosis tries it: for a law with a threshold (what sticks,
    yields or tears), whose response at one amplitude tells little of another's."""
    logarithmic: bool = False
    """Its logarithm is fitted."""
    source: str = ""
    """Where the number is defined; "" where the source of its law says it."""

    def __post_init__(self) -> None:
        given = (self.typical, *self.tried) if self.typical else self.tried
        outside = [value for value in given if not self.low <= value <= self.high]
        if outside:
            raise ValueError(f"{self.name}: {outside[0]:g} is not in its range, {self.low:g} to {self.high:g}")

    def encode(self, value: float) -> float:
        """Value -> coordinate of a fit."""
        return float(np.log(np.clip(value, self.low, self.high))) if self.logarithmic else value

    def decode(self, coordinate: float) -> float:
        """Coordinate of a fit -> value, kept inside the range."""
        value = float(np.exp(coordinate)) if self.logarithmic else coordinate
        return float(np.clip(value, self.low, self.high))

    def left_open(self, low: float, high: float) -> bool:
        """Tell whether an interval says hardly more than the range does; see the module."""
        low, high = max(low, self.low), min(high, self.high)
        if is_log_change(self.name):
            return high - low > math.log(OPEN_FACTOR)
        if self.logarithmic:
            return high > OPEN_FACTOR * low
        if high - low > OPEN_SHARE * (self.high - self.low):
            return True
        # of an amplitude, which is 0 where the law is absent, the size counts, whatever its sign
        smallest = 0.0 if low < 0 < high else min(abs(low), abs(high))
        largest, step = max(abs(low), abs(high)), abs(self.step)
        wide = step > 0 and max(abs(self.low), abs(self.high)) >= WIDE_RANGE * step
        return wide and max(largest, step) > OPEN_FACTOR * max(smallest, step)


def is_log_change(name: str) -> bool:
    """Tell whether a parameter is the change of a logarithm, by its name: its range is one of factors already."""
    return name.startswith("d_ln_")


@dataclass(frozen=True)
class Estimate:
    """What is known of one parameter's value."""

    value: float
    low: float = -math.inf
    """Lower end of the 95 % interval; -inf where it is not known, or the value was not fitted."""
    high: float = math.inf
    """Upper end of the 95 % interval, likewise."""
    unit: str = ""
    at_bound: bool = False
    """The fit ran into the allowed range: the number is a limit, not a measurement."""
    alternatives: tuple[float, ...] = ()
    """Other values that do as well, of a number that was tried with some values only."""
    fitted: bool = True
    """False for a number that was given, or chosen from a few: it has no interval."""
    open: bool = False
    """What was allowed before anything was measured is hardly narrowed down; see `within`."""

    @property
    def bounded(self) -> bool:
        """Tell whether both ends of the interval are known."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    @property
    def determined(self) -> bool:
        """Tell whether the recordings say what the number is; see the module."""
        return not self.open and not self.at_bound and (self.bounded or not self.fitted)

    def within(self, parameter: Parameter | None, tried: int = 0) -> Estimate:
        """Judge the estimate by the range that was allowed.

        Args:
            parameter: What it is an estimate of; None where no range is declared.
            tried: How many values were tried of a number that was chosen, of which at most half may do as well.
        """
        if not self.fitted:
            as_good = 1 + len(self.alternatives)
            return replace(self, open=as_good > 1 and 2 * as_good > tried)
        return replace(self, open=parameter is not None and self.bounded and parameter.left_open(self.low, self.high))

    def to_json(self) -> dict[str, Any]:
        """Write it as JSON types: infinite ends are null; "chosen" and "also" only of what was not fitted."""
        chosen = {} if self.fitted else {"chosen": True, "also": list(self.alternatives)}
        kept = {key: getattr(self, key) for key in ("value", "low", "high", "unit", "at_bound")}
        return dict(json_ready({**kept, **chosen, "determined": self.determined}))

    @classmethod
    def from_json(cls, found: Mapping[str, Any]) -> Estimate:
        """Read what `to_json` wrote.

        Raises:
            KeyError: There is no value.
            TypeError, ValueError: Something is no number.
        """
        low, high, determined = found.get("low"), found.get("high"), bool(found.get("determined", True))
        return cls(
            float(found["value"]),
            -math.inf if low is None else float(low),
            math.inf if high is None else float(high),
            str(found.get("unit") or ""),
            bool(found.get("at_bound")),
            tuple(map(float, found.get("also") or ())),
            # a number that is known without an interval was given, whatever else a file leaves out
            fitted=not (found.get("chosen") or (determined and None in (low, high))),
            open=not determined,
        )


def short_number(value: float | None) -> str:
    """Write three significant digits, without an exponent where that is readable: 1790, 0.0123, 1.2e+07."""
    return UNKNOWN if value is None or not math.isfinite(value) else f"{float(f'{value:.3g}'):g}"


def with_unit(number: str, unit: str | None) -> str:
    """Write a number's unit behind it; pure numbers, whose unit is "-" or nothing, stay alone."""
    return number if unit in (None, "", "-") else f"{number} {unit}"


def estimate_text(name: str, found: Estimate) -> str:
    """Write a number with interval and unit, or with what else it may be; an infinite interval is left out."""
    interval = f" ({short_number(found.low)} to {short_number(found.high)})" if found.bounded else ""
    return with_unit(f"{name} = {short_number(found.value)}{interval}{alternatives_text(found)}", found.unit)


def alternatives_text(found: Estimate) -> str:
    """Write the other values of a number that do as well, e.g. " (or 0.03, 0.1)"; "" where there are none."""
    return f" (or {', '.join(map(short_number, found.alternatives))})" if found.alternatives else ""


def checked_values(
    what: str, law: str, numbers: Iterable[Parameter], given: Mapping[str, float], *, units: str
) -> dict[str, float]:
    """Complete the given values with defaults.

    Args:
        what: Kind of law, for messages, e.g. "effect".
        law: Its name.
        numbers: All its numbers.
        given: Values by name.
        units: The units that are usual, for messages.

    Raises:
        PlopError: An unknown number, or a value that is out of range or not finite.
    """
    known = {number.name: number for number in numbers}
    for key in given:
        if key not in known:
            near = get_close_matches(key, known, 1) or list(known)
            raise PlopError(
                f"The {what} {law} has no such parameter.",
                where=f"{law}.{key}",
                expected=", ".join(known),
                found=key,
                fix=f"Did you mean {near[0]}?",
            )
    values = {key: float(given.get(key, number.default)) for key, number in known.items()}
    for key, number in known.items():
        if not (np.isfinite(values[key]) and number.low <= values[key] <= number.high):
            article = "an" if what[0] in "aeiou" else "a"
            raise PlopError(
                f"A parameter of {article} {what} is out of range.",
                where=f"{law}.{key}",
                expected=f"{number.low:g} to {number.high:g} {number.unit}",
                found=f"{values[key]:g}",
                fix=f"Check the unit: {units}.",
            )
    return values
