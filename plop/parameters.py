"""The numbers of a law, checked: what an effect of physics and a fault of a sensor have in common."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from plop.errors import PlopError
from plop.finite import UNKNOWN


@dataclass(frozen=True)
class Parameter:
    """One number of an effect's law."""

    name: str
    unit: str
    low: float
    """Least value that makes sense."""
    high: float
    """Largest value that makes sense."""
    step: float
    """Small amplitude at which the response is still linear, for sensitivities; 0 for a shape parameter."""
    default: float = 0.0
    """Value when nothing is given; 0 means 'absent' for an amplitude."""
    typical: float = 0.0
    """An amplitude at which the effect is plainly there; where to start when a signal of given size is wanted."""
    help: str = ""
    tried: tuple[float, ...] = ()
    """Further amplitudes, of either sign, at which a diagnosis tries it: for a law with a threshold (what sticks,
    yields or tears), whose response at one amplitude tells little of another's."""

    def __post_init__(self) -> None:
        given = (self.typical, *self.tried) if self.typical else self.tried
        outside = [value for value in given if not self.low <= value <= self.high]
        if outside:
            raise ValueError(f"{self.name}: {outside[0]:g} is not in its range, {self.low:g} to {self.high:g}")


def short_number(value: float | None) -> str:
    """Write three significant digits, without an exponent where that is readable: 1790, 0.0123, 1.2e+07."""
    return UNKNOWN if value is None or not math.isfinite(value) else f"{float(f'{value:.3g}'):g}"


def with_unit(number: str, unit: str | None) -> str:
    """Write a number's unit behind it; pure numbers, whose unit is "-" or nothing, stay alone."""
    return number if unit in (None, "", "-") else f"{number} {unit}"


def parameter_text(name: str, found: Mapping[str, Any]) -> str:
    """Write a fitted number with interval and unit, or with what else it may be; an infinite interval is left out.

    Args:
        name: Of the number.
        found: {"value", "low", "high", "unit"}, and "also", other values that do as well, for one that was tried with
            some values only.
    """
    known = all(end is not None and math.isfinite(end) for end in (found["low"], found["high"]))
    interval = f" ({short_number(found['low'])} to {short_number(found['high'])})" if known else ""
    return with_unit(f"{name} = {short_number(found['value'])}{interval}{also_text(found)}", found["unit"])


def also_text(found: Mapping[str, Any]) -> str:
    """Write the other values of a number that do as well, e.g. " (or 0.03, 0.1)"; "" where there are none."""
    also = found.get("also") or ()
    return f" (or {', '.join(map(short_number, also))})" if also else ""


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
