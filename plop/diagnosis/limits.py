"""Detection limits by injection and recovery: how large must an effect be to be seen in these very recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from plop.diagnosis.candidates import Column
from plop.diagnosis.contrast import MOSTLY, P_LARGEST, Contrast
from plop.diagnosis.finding import ERRORS_LEAST, GAIN_LEAST, STEADY_LEAST
from plop.diagnosis.regression import gain, held_out_energy, steady_gain
from plop.diagnosis.screen import Score, Screen

_STEPS = 24
StandsOut = Callable[[np.ndarray], bool]


@dataclass(frozen=True)
class Limit:
    """Smallest amplitude of a law that would have been named."""

    amplitude: float | None
    """None where none in its range would be."""
    unit: str
    parameter: str
    displacement_m: float | None
    """RMS displacement that it makes [m]."""


def detection_limits(
    screen: Screen,
    scores: list[Score],
    shams: np.ndarray,
    response_rms_m: Callable[[str], float],
    contrasts: Mapping[str, Contrast],
    stands_out: StandsOut = lambda _: False,
) -> dict[str, Limit]:
    """Inject each effect into the residuals that are left without it, and find the least amplitude that passes.

    It passes by as much as chance takes away in one of ten cases.

    Args:
        screen: The evidence.
        scores: One for each effect.
        shams: Best gains under shams.
        response_rms_m: RMS response of one unit of a column [m].
        contrasts: Effect -> which amplitudes differ clearly from the reference's; without it any does.
        stands_out: Held-out sums of squares [E] -> whether something is missing, whatever that is.

    Returns:
        By effect; see `unseen`.
    """
    threshold = float(np.quantile(shams, 1 - P_LARGEST))
    limits = {}
    for score in scores:
        name = score.candidate.effect
        limits[name] = _limit(screen, score, threshold, response_rms_m, contrasts.get(name), stands_out)
    return limits


def _limit(
    screen: Screen,
    score: Score,
    threshold: float,
    response_rms_m: Callable[[str], float],
    contrast: Contrast | None,
    stands_out: StandsOut,
) -> Limit:
    """Give the limit of the amplitude that moves least at its own: of a pull, the direction that is seen best."""
    found = []
    for k, column in enumerate(score.candidate.columns):
        clear = (0.0, 0.0) if contrast is None else (float(contrast.least[k]), float(contrast.least_alone[k]))
        amplitude = _least_seen(screen, score, column, threshold, clear, stands_out)
        if amplitude is not None:
            moved_m = amplitude * response_rms_m(column.key)
            found.append((moved_m, Limit(amplitude, column.unit, column.amplitude, moved_m)))
    return min(found, key=lambda pair: pair[0])[1] if found else unseen(score.candidate.columns[0])


def _least_seen(
    screen: Screen, score: Score, column: Column, threshold: float, clear: tuple[float, float], stands_out: StandsOut
) -> float | None:
    """Find the least amplitude of one column that passes; None where none in its range does.

    Args:
        screen: The evidence.
        score: Of the column's law.
        column: What is injected.
        threshold: Least gain.
        clear: Least amplitude that differs from the reference's, and the same where the error stands out by itself.
        stands_out: See `detection_limits`.
    """
    row, rows = screen.index[column.key], score.rows
    left = [e.residual - score.fit.values @ e.matrix[rows] for e in screen.episodes]

    def seen(amplitude: float) -> bool:
        if amplitude < clear[1]:
            return False
        loud = screen.with_residuals(
            [r + amplitude * e.matrix[row] for r, e in zip(left, screen.episodes, strict=True)]
        )
        null = loud.null(loud.grams, np.array([], int))
        before, after = (held_out_energy(loud.grams, columns) for columns in (null, rows))
        if amplitude < clear[0] and not stands_out(before):
            return False
        error = loud.gain_error(null, rows)
        won = gain(before, after)
        sure = won > ERRORS_LEAST * error and won - MOSTLY * error > max(GAIN_LEAST, threshold)
        return sure and steady_gain(before, after) > STEADY_LEAST

    low, high = 0.0, max(abs(column.low), abs(column.high))
    if not seen(high):
        return None
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if seen(middle) else (middle, high)
    return high


def unseen(column: Column) -> Limit:
    """Give the limit of a law of which no amplitude in its range would be seen."""
    return Limit(None, column.unit, column.amplitude, None)
