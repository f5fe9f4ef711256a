"""Time stamps in unknown units: detection of the unit, and exact conversion to nanoseconds.

The unit is determined by two properties of a column, never by its name. Its size: 1.7e9, 1.7e12, 1.7e15 and 1.7e18 are
today's Unix time in s, ms, us and ns, a thousand apart, while all dates from 2000 to 2050 lie within a factor of 2.7.
Its step: consecutive rows of a recording are between 0.2 ms and 4 s apart. For a clock with
its own origin the size is not informative: it has the unit that its format documents if that gives a plausible step,
and otherwise the one unit with the step of a camera (2 to 400 Hz: less than a factor of 1000, so never two).
The remaining ambiguity (1 Hz in s against 1 kHz in ms, both with their own origin) is resolved by the motion only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from plop.errors import PlopError


class TimeUnit(Enum):
    """A unit of time stamps; the value is its length in nanoseconds."""

    SECONDS = 10**9
    MILLISECONDS = 10**6
    MICROSECONDS = 10**3
    NANOSECONDS = 1

    @property
    def plural(self) -> str:
        """Its name in text."""
        return self.name.lower()


UNKNOWN = int(np.iinfo(np.int64).min)
"""Value of an unknown stamp, in nanoseconds."""
UNIX_S = (946_684_800, 2_524_608_000)
"""2000-01-01 and 2050-01-01 [s since 1970]: wide enough for a wrongly set clock, too narrow for an uptime."""
STEP_S = (0.2e-3, 4.0)
"""Plausible median step of a recording: 5 kHz to 0.25 Hz [s]."""
OWN_START_STEP_S = (0.9e-3, 2.2)
"""The same for a clock with its own origin, in its documented unit: 1.1 kHz to 0.45 Hz [s]."""
CAMERA_STEP_S = (1 / 400, 0.5)
"""Median step for detecting an undocumented unit: 10 to 240 Hz with a margin on both sides [s]."""
LONGEST_UPTIME_S = 2e9
"""Longest time since a clock's own origin (60 years) [s]."""
ASTRAY_S = 86_400.0
"""Largest distance of a valid stamp from the median of its column [s]."""


@dataclass(frozen=True)
class Clock:
    """One decoded column of stamps."""

    ns: np.ndarray
    """int64, shape [N] [ns] since 1970 or since the clock's own origin; UNKNOWN where there is none."""
    unit: TimeUnit
    """Original unit of the column."""
    since_1970: bool
    """False: it counts from its own origin."""
    where: str
    notes: tuple[str, ...] = ()
    """Notes for the user: discarded stamps, steps back. (Also compare `unit` with the documented one.)"""

    @property
    def known(self) -> np.ndarray:
        """Which stamps are known, bool, shape [N]."""
        return self.ns != UNKNOWN

    def since(self, origin_ns: int) -> np.ndarray:
        """Return seconds since a moment, float64, shape [N], from a difference of whole nanoseconds; NaN unknown."""
        return np.where(self.known, (np.where(self.known, self.ns, origin_ns) - origin_ns) / 1e9, np.nan)


def read_clock(
    values: np.ndarray | Sequence[Any],
    *,
    documented: TimeUnit,
    where: str,
    own_start_step_s: tuple[float, float] = OWN_START_STEP_S,
) -> Clock | None:
    """Detect the unit of a column of stamps and convert them to nanoseconds.

    Args:
        values: Whole or decimal numbers in order of time, shape [N]: an array, or a list from JSON (its numbers
            may be texts, as int64 often is in JSON). NaN, infinity, null and negative numbers are unknown; so is 0,
            unless it is the first stamp and the only zero.
        documented: The unit that the format documents.
        where: File and key, for messages.
        own_start_step_s: Range of the median step in which a clock with its own origin keeps the documented unit [s].

    Returns:
        The clock; None where no stamp is known.

    Raises:
        PlopError: It is constant, runs backwards, counts frames, is too coarse, or has no plausible unit.
    """
    exact, known = _exact(values, where)
    if not known.any():
        return None
    unit, since_1970 = _unit(exact, known, documented, where, own_start_step_s)
    notes = []
    with np.errstate(invalid="ignore"):
        astray = known & (np.abs(exact - np.median(exact[known])) > ASTRAY_S * 1e9 / unit.value)
    if astray.any():
        notes.append(
            f"{where}: {int(astray.sum())} of {len(known)} stamps differ by days from the others and are discarded, "
            f"the first in row {int(np.argmax(astray))}"
        )
    ns = _nanoseconds(exact, known & ~astray, unit)
    back = np.flatnonzero(np.diff(ns[ns != UNKNOWN]) < 0)
    if len(back):
        rows = np.flatnonzero(ns != UNKNOWN)
        shift = (ns[rows[back[0]]] - ns[rows[back[0] + 1]]) / 1e9
        notes.append(
            f"{where}: the clock goes back {len(back)} times, first by {shift:.3g} s at row {rows[back[0] + 1]}"
        )
    return Clock(ns, unit, since_1970, where, tuple(notes))


def check_together(clocks: Mapping[str, Clock]) -> None:
    """Reject inconsistent clocks of one recording.

    Args:
        clocks: Clocks by their name in messages, e.g. "the robot's clock".

    Raises:
        PlopError: One counts since 1970 and another from its own origin, or their spans differ by a factor of 30 or
            more.
    """
    names = list(clocks)
    for name in names[1:]:
        one, other = clocks[names[0]], clocks[name]
        if one.since_1970 != other.since_1970:
            raise PlopError(
                "Two clocks of a recording have different origins.",
                where=other.where,
                expected="the same origin for all clocks",
                found=f"{name} counts {_start(other)}, {names[0]} {_start(one)} ({one.where})",
                fix="Write all stamps from one clock.",
            )
        spans = [float(np.ptp(clock.ns[clock.known])) / 1e9 for clock in (one, other)]
        if min(spans) > 0 and max(spans) > 30 * min(spans):
            raise PlopError(
                "Two clocks of a recording run at different rates.",
                where=other.where,
                expected="the same unit for all clocks, or the unit that the format documents",
                found=f"{names[0]} spans {spans[0]:.4g} s and {name} {spans[1]:.4g} s",
                fix=f"Correct the unit of {name} or of {names[0]} ({one.where}).",
            )


def _start(clock: Clock) -> str:
    return "since 1970" if clock.since_1970 else f"from its own origin ({clock.ns[clock.known][0] / 1e9:.6g} s)"


def _exact(values: np.ndarray | Sequence[Any], where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers without loss, int64 or float64, and which are known."""
    array = np.asarray(values) if isinstance(values, np.ndarray) else _from_list(values, where)
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise PlopError(
            "Time stamps cannot be read.",
            where=where,
            expected="a list of numbers",
            found=f"{array.dtype}, shape {array.shape}",
            fix="Write one number per row.",
        )
    if array.dtype.kind == "f":
        known = np.isfinite(array) & (array >= 0)
        exact: np.ndarray = np.where(known, array, 0).astype(np.float64)
    else:
        known = (array >= 0) & (array <= np.iinfo(np.int64).max)
        exact = np.where(known, array, 0).astype(np.int64)
    zero = known & (exact == 0)
    return exact, known if _starts_at_zero(exact, known, zero) else known & ~zero


def _starts_at_zero(exact: np.ndarray, known: np.ndarray, zero: np.ndarray) -> bool:
    """Return whether the only zero is the first stamp, at most ten usual steps before the next."""
    rows = np.flatnonzero(known)
    if zero.sum() != 1 or len(rows) < 3 or not zero[rows[0]]:
        return False
    return bool(exact[rows[1]] <= 10 * np.median(np.abs(np.diff(exact[rows[1:]]))))


def _from_list(values: Sequence[Any], where: str) -> np.ndarray:
    """Read a list without converting integers to floats; null becomes -1, a text the number in it."""
    numbers: list[int | float] = []
    for row, value in enumerate(values):
        try:
            if isinstance(value, str):
                value = int(value) if value.strip().lstrip("+-").isdigit() else float(value)
            if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
                raise ValueError
        except ValueError:
            raise PlopError(
                "A time stamp is not a number.",
                where=f"{where}: entry {row}",
                expected="a number",
                found=str(value)[:40],
                fix="Write one number per frame.",
            ) from None
        numbers.append(-1 if value is None else value)
    whole = all(isinstance(number, int) and abs(number) < 2**63 for number in numbers)
    return np.array(numbers, dtype=np.int64 if whole else np.float64)


def _unit(
    exact: np.ndarray, known: np.ndarray, documented: TimeUnit, where: str, own_start_step_s: tuple[float, float]
) -> tuple[TimeUnit, bool]:
    """Determine unit and origin of the known stamps; see the module docstring."""
    middle = float(np.median(exact[known]))
    sized = [unit for unit in TimeUnit if UNIX_S[0] <= middle * unit.value / 1e9 < UNIX_S[1]]
    if known.sum() < 2:
        return (sized[0], True) if sized else (documented, False)
    step = _step(exact, known, sized, where)
    fits = {unit: step * unit.value / 1e9 for unit in TimeUnit}
    for unit in sized:
        if STEP_S[0] <= fits[unit] <= STEP_S[1]:
            return unit, True
    short = [unit for unit in TimeUnit if middle * unit.value / 1e9 <= LONGEST_UPTIME_S]
    if documented in short and own_start_step_s[0] <= fits[documented] <= own_start_step_s[1]:
        return documented, False
    camera = [unit for unit in TimeUnit if CAMERA_STEP_S[0] <= fits[unit] <= CAMERA_STEP_S[1]]
    if camera and camera[0] in short:
        return camera[0], False
    read = sized[0] if sized else documented
    lasts = float(np.ptp(exact[known])) * read.value / 1e9
    right = [unit for unit in TimeUnit if STEP_S[0] <= fits[unit] <= STEP_S[1]]
    advice = ", or ".join(
        f"in {unit.plural} it would span {_long(lasts * unit.value / read.value)} ({1 / fits[unit]:.3g} rows a second)"
        for unit in camera or right
    )
    raise PlopError(
        "The duration of the recording according to its clock is not plausible.",
        where=where,
        expected=f"rows {own_start_step_s[0]:.3g} to {own_start_step_s[1]:g} s apart",
        found=f"in {read.plural}{', from the size of its stamps,' if sized else ''} it spans "
        f"{_long(lasts)}, rows {fits[read]:.3g} s apart" + (f"; {advice}" if advice else ""),
        fix=f"Write the stamps in {documented.plural}.",
    )


def _step(exact: np.ndarray, known: np.ndarray, sized: list[TimeUnit], where: str) -> float:
    """Return the median step per row of a running clock; rows without a stamp are included.

    Raises:
        PlopError: It is constant, runs backwards, is too coarse, or counts frames.
    """
    rows = np.flatnonzero(known)
    steps = np.diff(exact[rows])
    ahead, behind = int((steps > 0).sum()), int((steps < 0).sum())
    if not ahead or behind > ahead:
        what = "backwards" if behind else f"not at all ({exact[rows[0]]:.10g} in every row)"
        raise PlopError(
            "A clock does not advance.",
            where=where,
            expected="stamps that increase",
            found=f"it runs {what}",
            fix="Sort the rows by time." if behind else "Store the time of each row.",
        )
    step = float(np.median(steps[steps > 0] / np.diff(rows)[steps > 0]))
    coarse = next((unit for unit in sized if step * unit.value / 1e9 >= 0.5), None)
    if coarse is not None and ahead < len(steps) / 2:
        raise PlopError(
            "A clock is too coarse for its rows.",
            where=where,
            expected="a different stamp in every row",
            found=f"{len(steps) - ahead} of {len(steps)} stamps equal the one before; they are "
            f"{step * coarse.value / 1e9:g} s apart where they differ",
            fix="The stamps were rounded to whole seconds, or stored as float32: "
            "store int64 nanoseconds or float64 seconds.",
        )
    if not sized and len(steps) > 1 and (steps == np.diff(rows)).all() and exact[rows[0]] in (0, 1):
        raise PlopError(
            "The times are frame numbers.",
            where=where,
            expected="times",
            found=f"{exact[rows[0]]:g}, {exact[rows[1]]:g}, ... {exact[rows[-1]]:g}: steps of 1",
            fix="Divide them by the frame rate, in the unit that the format documents.",
        )
    return step


def _nanoseconds(exact: np.ndarray, known: np.ndarray, unit: TimeUnit) -> np.ndarray:
    """Convert to int64 nanoseconds; integer and fractional part separately, to keep a float's precision."""
    known = known & (np.abs(exact) < np.iinfo(np.int64).max // unit.value)
    values = np.where(known, exact, 0)
    whole = np.floor(values) if values.dtype.kind == "f" else values
    rest = np.rint((values - whole) * unit.value).astype(np.int64)
    return np.where(known, whole.astype(np.int64) * unit.value + rest, UNKNOWN)


def _long(seconds: float) -> str:
    for name, length in (("days", 86400.0), ("hours", 3600.0), ("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= (2 if name in ("days", "hours") else 1) * length:
            return f"{seconds / length:.3g} {name}"
    return f"{seconds:.3g} s"
