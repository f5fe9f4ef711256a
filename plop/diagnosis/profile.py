"""The error over the amplitude of a law: its least, and which amplitudes the engine's response cannot tell apart.

Responses are not proportional to amplitudes. The least error is looked for among runs of the engine itself, at
amplitudes a factor of two apart, from the fitted one towards where the error falls, and lies at the vertex of the
parabola, over the length of the response, through the best three, where the engine is run again. Near the end of its
range a response may grow without bounds: then the vertex creeps, and the wider side is halved instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from plop.diagnosis.candidates import Column

STEP = 2.0
"""Ratio of neighbouring amplitudes."""
FURTHER = 3
"""How often the search goes on where the error still falls at an end."""
CLOSER = 4
"""How often the engine is run where the least error should be by the runs so far."""
_LOPSIDED = 2.0
"""How many times as far the next run on one side may be as that on the other before the wider side is halved."""
_WIDE = 0.2
"""Logarithm of the ratio of neighbouring amplitudes from which there is room for a least error between them."""
_BENT = 0.5
"""Difference of the exponents with which a response grows below and above a run, from which a parabola is doubtful."""
_NEAR = 1.05
"""Ratio of two amplitudes between which nothing is looked for."""
_SLOPES = 0.1, 2.0
"""Limits of the exponent with which a response is taken to go on beyond the runs."""
Measure = Callable[[Sequence[tuple[Column, float]]], Sequence[tuple[float, float] | None]]
"""Columns and amplitudes -> sum of squares left and length of the response, whitened [-]; None: an unstable run."""


@dataclass(frozen=True)
class Profile:
    """One column's error and response at several amplitudes of one sign, the smallest first; at least one."""

    amplitudes: np.ndarray
    """[A]."""
    energy: np.ndarray
    """Sum of squares left, the base's own parameters refitted, [A]."""
    size: np.ndarray
    """Length of the response over all episodes, [A]."""

    @property
    def best(self) -> int:
        """Number of the run that leaves least."""
        return int(np.argmin(self.energy))

    def least(self) -> float:
        """Give the amplitude of the least error."""
        k = self.best
        if k in (0, len(self.amplitudes) - 1):
            return float(self.amplitudes[k])
        place, size = np.log(np.abs(self.amplitudes[k - 1 : k + 2])), self.size[k - 1 : k + 2]
        if size[0] <= 0 or (np.diff(size) <= 0).any():
            return float(self.amplitudes[k])
        # the error is a parabola over the length of the response as long as only that changes, not its direction
        curve = np.polyfit(size - size[1], self.energy[k - 1 : k + 2], 2)
        vertex = np.clip(size[1] - curve[1] / (2 * curve[0]) if curve[0] > 0 else size[1], size[0], size[2])
        return float(np.sign(self.amplitudes[k]) * np.exp(np.interp(np.log(vertex), np.log(size), place)))

    def halved(self) -> float | None:
        """Give the middle between the run that leaves least and its farther neighbour; None where there is no room."""
        sides = self._sides()
        wider = max(sides, key=lambda near: abs(sides[near]), default=0)
        if not sides or abs(sides[wider]) < _WIDE:
            return None
        return float(self.amplitudes[self.best] * np.exp(sides[wider] / 2))

    def _sides(self) -> dict[int, float]:
        """Logarithms of the neighbours' amplitudes over that of the run that leaves least, by neighbour."""
        place, k = np.log(np.abs(self.amplitudes)), self.best
        return {near: place[near] - place[k] for near in (k - 1, k + 1) if 0 <= near < len(place)}

    @property
    def lopsided(self) -> bool:
        """Whether the run that leaves least is the last on one side, or much farther from one neighbour."""
        gaps = np.abs(list(self._sides().values()))
        return len(gaps) < 2 or bool(gaps.max() > _LOPSIDED * gaps.min())

    @property
    def bent(self) -> bool:
        """Whether the response grows much faster with the amplitude on one side of the run that leaves least."""
        around = slice(max(self.best - 1, 0), self.best + 2)
        size = np.log(np.maximum(self.size[around], 1e-30))
        slopes = np.diff(size) / np.diff(np.log(np.abs(self.amplitudes[around])))
        return len(slopes) == 2 and bool(abs(slopes[1] - slopes[0]) > _BENT)

    def at_response(self, value: float, factor: float) -> float:
        """Find the amplitude whose response is so many times (> 0) that of another one; infinite where none is."""
        sign = np.sign(self.amplitudes[-1])
        place = np.log(np.abs(self.amplitudes))
        size = np.log(np.maximum(np.maximum.accumulate(self.size), 1e-30))
        if len(place) < 2:
            return value * factor
        slopes = np.clip(np.diff(size) / np.diff(place), *_SLOPES)

        def of(x: float) -> float:
            beyond = slopes[0] * min(x - place[0], 0) + slopes[-1] * max(x - place[-1], 0)
            return float(np.interp(x, place, size) + beyond)

        wanted = of(float(np.log(abs(value)))) + np.log(factor)
        if wanted < size[0]:
            found = place[0] + (wanted - size[0]) / slopes[0]
        elif wanted > size[-1]:
            found = place[-1] + (wanted - size[-1]) / slopes[-1]
        else:
            rising = np.flatnonzero(np.diff(size, prepend=-np.inf) > 0)
            found = np.interp(wanted, size[rising], place[rising])
        return float(sign * np.exp(min(found, 600.0)))


def profiles_of(columns: Sequence[Column], measure: Measure) -> dict[str, Profile]:
    """Search along each column from its amplitude, all columns side by side.

    Args:
        columns: Where to start; one whose runs are all unstable gets no profile.
        measure: Runs the engine.
    """
    found: dict[str, dict[float, tuple[float, float] | None]] = {column.key: {} for column in columns}
    asked = {column.key: [column.value / STEP, column.value, column.value * STEP] for column in columns}
    for _ in range(1 + FURTHER):
        jobs = [
            (c, inside)
            for c in columns
            for inside in dict.fromkeys(_within(c, a) for a in asked[c.key])
            if inside not in found[c.key]
        ]
        if not jobs:
            break
        for (column, amplitude), answer in zip(jobs, measure(jobs), strict=True):
            found[column.key][amplitude] = answer
        asked = {column.key: _next(found[column.key]) for column in columns}
    for _ in range(CLOSER):
        jobs = [(column, at) for column in columns if (at := _closer(found[column.key])) is not None]
        for (column, amplitude), answer in zip(jobs, measure(jobs) if jobs else [], strict=True):
            found[column.key][amplitude] = answer
    return {key: _profile(runs) for key, runs in found.items() if any(answer for answer in runs.values())}


def _within(column: Column, amplitude: float) -> float:
    return float(np.clip(amplitude, column.low, column.high))


def _next(runs: dict[float, tuple[float, float] | None]) -> list[float]:
    """Where to look further: beyond the end at which the error is least; nowhere when it is least inside."""
    order = sorted(runs, key=abs)
    known = [(answer[0], a) for a in order if (answer := runs[a]) is not None]
    if not known:
        return [order[0] / STEP]
    best = min(known)[1]
    ends = {order[0]: best / STEP, order[-1]: best * STEP}
    return [ends[best]] if best in ends else []


def _closer(runs: dict[float, tuple[float, float] | None]) -> float | None:
    """Where the least error should be by the runs so far; None where one of them is near, or all are unstable.

    At an end of the range it may also lie inside, before the next run.
    """
    if not any(runs.values()):
        return None
    profile = _profile(runs)
    least, half = profile.least(), profile.halved()
    near = any(1 / _NEAR < amplitude / least < _NEAR for amplitude in runs)
    if half is not None and (profile.lopsided or near and profile.bent):
        return half
    return None if near else least


def _profile(runs: dict[float, tuple[float, float] | None]) -> Profile:
    known = [(a, *answer) for a in sorted(runs, key=abs) if (answer := runs[a]) is not None]
    amplitudes, energy, size = np.array(known).T
    return Profile(amplitudes, energy, size)
