"""A number of a law or of a material: its declaration (`Parameter`) and its estimate from recordings (`Estimate`).

An estimate is *not determined* if the fit is at a bound of its allowed range, if an end of its 95 % interval is
unknown, or if the interval is hardly narrower than the range: it covers half of the range, or, for a number on a
logarithmic scale (a stiffness, the strength of a law), a factor of ten. Half and ten are conventions: such a
measurement has not even halved the range, or leaves the order of magnitude open.
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
"""Text for such a number."""
NORMAL_95 = 1.96
"""Half the width of a 95 % interval, in standard deviations of a normal distribution."""
OPEN_SHARE, OPEN_FACTOR = 0.5, 10.0
"""Width of an uninformative interval: share of the range, or factor of a number on a logarithmic scale."""
WIDE_RANGE = 100.0
"""A range of so many smallest steps is hardly a bound: half of it would be far too wide."""


@dataclass(frozen=True)
class Parameter:
    """Declaration of one number of a law, a material or a sensor fault."""

    name: str
    unit: str
    low: float
    """Smallest meaningful value."""
    high: float
    """Largest meaningful value."""
    step: float
    """Finite difference at which the response is still linear, on the scale of the fit; 0 for a shape parameter."""
    default: float = 0.0
    """Default value; 0 means 'absent' for an amplitude."""
    typical: float = 0.0
    """An amplitude at which the effect is clearly visible; the start of a search for a given signal."""
    help: str = ""
    tried: tuple[float, ...] = ()
    """Further amplitudes, of either sign, at which a diagnosis tries it: for a law with a threshold (sticking,
    yielding, tearing), whose response at one amplitude does not predict that at another."""
    logarithmic: bool = False
    """Whether its logarithm is fitted."""
    prior: float = math.inf
    """Standard deviation of what is known before a fit, on its scale; infinite: nothing."""
    model_error: float = 0.0
    """Standard deviation of a fit's error that the model itself causes, on its scale: more recordings do not help."""
    source: str = ""
    """Source of the number; "" where that of its law applies."""

    def __post_init__(self) -> None:
        given = (self.typical, *self.tried) if self.typical else self.tried
        outside = [value for value in given if not self.low <= value <= self.high]
        if outside:
            raise ValueError(f"{self.name}: {outside[0]:g} is not in its range, {self.low:g} to {self.high:g}")

    def encode(self, value: float) -> float:
        """Value -> coordinate of a fit."""
        return float(np.log(np.clip(value, self.low, self.high))) if self.logarithmic else value

    def decode(self, coordinate: float) -> float:
        """Coordinate of a fit -> value, clamped to the range."""
        value = float(np.exp(coordinate)) if self.logarithmic else coordinate
        return float(np.clip(value, self.low, self.high))

    def left_open(self, low: float, high: float) -> bool:
        """Return whether an interval is hardly narrower than the range; see the module."""
        low, high = max(low, self.low), min(high, self.high)
        if is_log_change(self.name):
            return high - low > math.log(OPEN_FACTOR)
        if self.logarithmic:
            return high > OPEN_FACTOR * low
        if high - low > OPEN_SHARE * (self.high - self.low):
            return True
        # for an amplitude, which is 0 where the law is absent, the absolute value is used
        smallest = 0.0 if low < 0 < high else min(abs(low), abs(high))
        largest, step = max(abs(low), abs(high)), abs(self.step)
        wide = step > 0 and max(abs(self.low), abs(self.high)) >= WIDE_RANGE * step
        return wide and max(largest, step) > OPEN_FACTOR * max(smallest, step)


def is_log_change(name: str) -> bool:
    """Return whether a parameter is the change of a logarithm, by its name: its range is already one of factors."""
    return name.startswith("d_ln_")


@dataclass(frozen=True)
class Estimate:
    """Estimate of one parameter's value."""

    value: float
    low: float = -math.inf
    """Lower end of the 95 % interval; -inf where it is unknown, or the value was not fitted."""
    high: float = math.inf
    """Upper end of the 95 % interval, likewise."""
    unit: str = ""
    at_bound: bool = False
    """Whether the fit is at a bound of the allowed range: the number is a limit, not a measurement."""
    alternatives: tuple[float, ...] = ()
    """Other values that fit equally well, for a number that was tried at discrete values."""
    fitted: bool = True
    """False for a number that was given, or chosen from discrete values: it has no interval."""
    open: bool = False
    """Whether the interval is hardly narrower than the allowed range; see `within`."""

    @property
    def bounded(self) -> bool:
        """Return whether both ends of the interval are known."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    @property
    def determined(self) -> bool:
        """Return whether the recordings determine the number; see the module."""
        return not self.open and not self.at_bound and (self.bounded or not self.fitted)

    def within(self, parameter: Parameter | None, tried: int = 0) -> Estimate:
        """Compare the estimate with its allowed range.

        Args:
            parameter: The declaration; None where no range is declared.
            tried: Number of discrete values that were tried; at most half of them may fit equally well.
        """
        if not self.fitted:
            as_good = 1 + len(self.alternatives)
            return replace(self, open=as_good > 1 and 2 * as_good > tried)
        return replace(self, open=parameter is not None and self.bounded and parameter.left_open(self.low, self.high))

    def with_model_error(self, parameter: Parameter) -> Estimate:
        """Widen the interval by what the model's own error does to a fit, which the data do not show."""
        if not self.bounded:
            return self
        middle, error = parameter.encode(self.value), NORMAL_95 * parameter.model_error
        low, high = (math.hypot(parameter.encode(end) - middle, error) for end in (self.low, self.high))
        return replace(self, low=parameter.decode(middle - low), high=parameter.decode(middle + high)).within(parameter)

    def to_json(self) -> dict[str, Any]:
        """Write it as JSON types: infinite ends are null; "chosen" and "also" only if not fitted."""
        chosen = {} if self.fitted else {"chosen": True, "also": list(self.alternatives)}
        kept = {key: getattr(self, key) for key in ("value", "low", "high", "unit", "at_bound")}
        return dict(json_ready({**kept, **chosen, "determined": self.determined}))

    @classmethod
    def from_json(cls, found: Mapping[str, Any]) -> Estimate:
        """Read what `to_json` wrote.

        Raises:
            KeyError: There is no value.
            TypeError, ValueError: A value is not a number.
        """
        low, high, determined = found.get("low"), found.get("high"), bool(found.get("determined", True))
        return cls(
            float(found["value"]),
            -math.inf if low is None else float(low),
            math.inf if high is None else float(high),
            str(found.get("unit") or ""),
            bool(found.get("at_bound")),
            tuple(map(float, found.get("also") or ())),
            # a value without an interval was given, whatever else a file leaves out
            fitted=not (found.get("chosen") or (determined and None in (low, high))),
            open=not determined,
        )


def short_number(value: float | None) -> str:
    """Format three significant digits, without an exponent where possible: 1790, 0.0123, 1.2e+07."""
    return UNKNOWN if value is None or not math.isfinite(value) else f"{float(f'{value:.3g}'):g}"


def with_unit(number: str, unit: str | None) -> str:
    """Append the unit to a number; pure numbers, whose unit is "-" or empty, have none."""
    return number if unit in (None, "", "-") else f"{number} {unit}"


def estimate_text(name: str, found: Estimate) -> str:
    """Format a number with interval and unit, or with its alternatives; an infinite interval is left out."""
    interval = f" ({short_number(found.low)} to {short_number(found.high)})" if found.bounded else ""
    return with_unit(f"{name} = {short_number(found.value)}{interval}{alternatives_text(found)}", found.unit)


def alternatives_text(found: Estimate) -> str:
    """Format the other values that fit equally well, e.g. " (or 0.03, 0.1)"; "" where there are none."""
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
        units: The usual units, for messages.

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
