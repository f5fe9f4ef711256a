"""Axes and units declared in the files of a simulator, and the conversion to plop's world (metres, seconds, z up).

Only explicit declarations are used: the default of a format is a guess about data of another author. Contradicting
files are rejected, because it is unknown which of them is right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plop.errors import PlopError

WORLD_FROM_UP = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "-y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "-x": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
}
"""Rotation to z up, by the up axis of the file."""
METRES = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
"""Length of each unit [m]."""
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Length of each unit [s]."""
_LONG_NAMES = {
    "metre": "m",
    "meter": "m",
    "decimetre": "dm",
    "decimeter": "dm",
    "centimetre": "cm",
    "centimeter": "cm",
    "millimetre": "mm",
    "millimeter": "mm",
    "micrometre": "um",
    "micrometer": "um",
    "inche": "in",
    "inch": "in",
    "foot": "ft",
    "feet": "ft",
    "second": "s",
    "sec": "s",
    "millisecond": "ms",
    "microsecond": "us",
    "nanosecond": "ns",
}
_UPTIME_S = 86_400.0
"""Times that start later than this are dates, and are counted from their first frame [s]."""
_ALIKE = 1e-6


@dataclass(frozen=True)
class Declared:
    """Declarations of one file, or of all; None where there is none."""

    source: str
    """File and key, for messages."""
    up: str | None = None
    """Key of WORLD_FROM_UP."""
    metres: float | None = None
    """Length of one unit [m]."""
    seconds: float | None = None
    """Length of one unit of time [s]."""

    @property
    def said(self) -> frozenset[str]:
        """Which of "up", "length" and "time" are declared."""
        values = {"up": self.up, "length": self.metres, "time": self.seconds}
        return frozenset(key for key, value in values.items() if value is not None)


@dataclass(frozen=True)
class WorldFrame:
    """The transformation from a file's axes and unit of length to the world."""

    up: str
    metres: float

    def points(self, points: np.ndarray) -> np.ndarray:
        """Transform positions [..., 3] in the file's axes and unit to the world [m]."""
        turned = points @ WORLD_FROM_UP[self.up].T if self.up != "z" else points
        return turned * self.metres if self.metres != 1 else turned

    def rotations(self, rotations: np.ndarray) -> np.ndarray:
        """Transform rotations [..., 3, 3] between axes of the file to the world's axes."""
        turn = WORLD_FROM_UP[self.up]
        return turn @ rotations @ turn.T


def declared_in_side_file(side: Mapping[str, Any], path: Path) -> Declared:
    """Read `units` of an episode's JSON file: length, up, time, frames_per_second.

    Raises:
        PlopError: A unit is unknown, or time and frames_per_second contradict each other.
    """
    units, where = side.get("units", {}), f"{path}: units"
    up = units.get("up")
    if up is not None:
        up = str(up).lower().lstrip("+").removesuffix("-up")
        if up not in WORLD_FROM_UP:
            raise _unknown(f"{where}.up", "x, y, z, -x, -y or -z", units["up"])
    metres = _length(units.get("length"), METRES, f"{where}.length")
    seconds = None if units.get("time") == "frames" else _length(units.get("time"), SECONDS, f"{where}.time")
    rate = units.get("frames_per_second")
    if rate is not None and (type(rate) not in (int, float) or not 0 < rate < 1e7):
        raise _unknown(f"{where}.frames_per_second", "a positive number", rate)
    if rate is None and units.get("time") == "frames":
        raise _unknown(f"{where}.frames_per_second", 'a number beside "time": "frames"', None)
    if rate is not None and seconds is not None:
        raise PlopError(
            "The JSON file gives two units of time.",
            where=where,
            expected="time, or frames_per_second where times are frame numbers",
            found=f"time {units['time']!r} and frames_per_second {rate:g}",
            fix='Remove one of them (if times are frame numbers: "time": "frames").',
        )
    return Declared(where, up, metres, 1 / rate if rate is not None else seconds)


def _length(value: Any, table: Mapping[str, float], where: str) -> float | None:
    if value is None:
        return None
    name = str(value).strip()
    name = name if name in table else _LONG_NAMES.get(name.lower().removesuffix("s"), name.lower())
    name = _LONG_NAMES.get(name, name)
    if name not in table:
        raise _unknown(where, ", ".join(table), value)
    return table[name]


def _unknown(where: str, expected: str, value: Any) -> PlopError:
    return PlopError(
        "The recording declares a unit that plop does not know.",
        where=where,
        expected=expected,
        found=repr(value),
        fix="Correct it, or convert the recording to metres and seconds.",
    )


def together(one: Declared, other: Declared) -> Declared:
    """Merge the declarations of two files of one recording.

    Raises:
        PlopError: They contradict each other; both are named.
    """
    if one.up is not None and other.up is not None and one.up != other.up:
        raise _contradiction(one, other, "up axis", one.up, other.up)
    for what, key in (("unit of length [m]", "metres"), ("unit of time [s]", "seconds")):
        first, second = getattr(one, key), getattr(other, key)
        if first is not None and second is not None and abs(first / second - 1) > _ALIKE:
            raise _contradiction(one, other, what, f"{first:g}", f"{second:g}")
    return Declared(
        f"{one.source}, {other.source}", one.up or other.up, one.metres or other.metres, one.seconds or other.seconds
    )


def _contradiction(one: Declared, other: Declared, what: str, first: str, second: str) -> PlopError:
    return PlopError(
        "Two files of a recording declare different units or axes.",
        where=one.source,
        expected=f"the same {what} in both",
        found=f"{first} in {one.source}, {second} in {other.source}",
        fix="Correct the wrong one, or remove it from the file.",
    )


def seconds_from(times: np.ndarray, unit_s: float) -> tuple[np.ndarray, list[str]]:
    """Convert times; dates are counted from their first frame, which is subtracted before rounding.

    Args:
        times: Shape [T], whole or decimal.
        unit_s: Length of their unit [s].

    Returns:
        Seconds, float64, and a note where the start was subtracted.
    """
    exact = times.astype(np.int64) if times.dtype.kind in "ui" else times.astype(np.float64)
    if not len(exact) or not abs(float(exact[0])) * unit_s > _UPTIME_S:
        return exact.astype(np.float64) * unit_s if unit_s != 1 else exact.astype(np.float64), []
    return (exact - exact[0]).astype(np.float64) * unit_s, [
        f"times start at {float(exact[0]):.10g}: they are counted from the first frame"
    ]
