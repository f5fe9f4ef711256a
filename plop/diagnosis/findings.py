"""Scores turned into findings: parameters with units and intervals, p, and the contrast with the reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plop.diagnosis.amplitude import parameters_of
from plop.diagnosis.contrast import Contrast, contrast_of
from plop.diagnosis.finding import LONE_SHARE, Finding
from plop.diagnosis.regression import fit, gain, most_helped, steady_gain
from plop.diagnosis.screen import Score
from plop.diagnosis.shams import p_value
from plop.diagnosis.state import State
from plop.parameters import Estimate


def finding_of(state: State, score: Score, shams: np.ndarray, beside: bool = False) -> Finding:
    """Add parameters, intervals, p and contrast to a score.

    Args:
        state: All that was computed.
        score: Of one effect.
        shams: Best gains under shams.
        beside: It was scored on what another law leaves: its amplitude is the one fitted together with that law's,
            and the whole library was looked through for it.
    """
    columns = score.candidate.columns
    parameters = parameters_of(columns, score.fit, state.profiles, alone=not beside)
    others = [] if beside else state.settings(score)
    _widen(state, parameters, others)
    units = dict(score.candidate.shape_units)
    for name, value in columns[0].shapes:
        also = sorted({dict(other.candidate.columns[0].shapes)[name] for other in others} - {value})
        parameters[name] = Estimate(value, unit=units.get(name, ""), alternatives=tuple(also), fitted=False)
    contrast = _contrast(state, score.rows, len(columns), whole_library=beside)
    return Finding(
        score.candidate.effect,
        score.candidate.kind,
        parameters,
        score.gain,
        score.gain_error,
        p_value(score.gain, shams),
        contrast,
        steady_gain(score.before, score.after),
        score.alone,
        _apart(state, score),
        state.evidence[most_helped(score.before, score.after)].name,
        float(score.shown.sum()),
        _shown_by(state, score.shown),
    )


def beyond(state: State, best: Score, shams: np.ndarray) -> tuple[Finding, float] | None:
    """Find the law that explains most of what the best one leaves; its gain is a share of that.

    Args:
        state: All that was computed.
        best: What is taken for granted.
        shams: Best gains under shams.

    Returns:
        The finding, with its amplitude fitted together with the best one's, and the mean squared residual
        with both; None without another law.
    """
    others = state.screen.scores(state.response_rms_m, given=best.candidate)
    law = next((score for score in others if score.candidate.kind == "physics"), None)
    if law is None:
        return None
    return finding_of(state, law, shams, beside=True), state.left(law)


def base_finding(state: State, shams: np.ndarray) -> Finding:
    """Judge a change of the base's own parameters, against leaving them as they are."""
    raw, refitted = state.screen.grams.energy, state.screen.refitted()
    rows = state.screen.base
    fitted = fit(state.screen.grams, rows)
    columns = [column for c in state.base_candidates for column in c.columns]
    improvement, error = gain(raw, refitted), state.screen.gain_error(np.array([], int), rows)
    contrast = _contrast(state, rows, len(rows))
    # The same kind of p as for effects: sham gains are shares of the error, too.
    return Finding(
        "stiffness",
        "base",
        parameters_of(tuple(columns), fitted, state.profiles),
        improvement,
        error,
        p_value(improvement, shams),
        contrast,
        alone=improvement,
    )


def _widen(state: State, parameters: dict[str, Estimate], settings: Sequence[Score]) -> None:
    """Let intervals hold what the amplitude is in other settings of the law that do as well."""
    for other in settings:
        columns = other.candidate.columns
        if not all(column.key in state.profiles for column in columns):
            continue
        for name, given in state.amplitudes(other).items():
            own = parameters[name]
            parameters[name] = replace(own, low=min(own.low, given.low), high=max(own.high, given.high))


def _shown_by(state: State, shown: np.ndarray) -> str:
    most = int(np.argmax(shown))
    return state.evidence[most].name if shown[most] > LONE_SHARE * shown.sum() else ""


def _apart(state: State, score: Score) -> float:
    """Standard error of the difference in held-out error, an effect alone against the base's parameters alone."""
    error = state.screen.gain_error(state.screen.base, state.screen.columns(score.candidate))
    return error * float(state.screen.refitted().sum() / max(state.screen.grams.energy.sum(), 1e-30))


def _contrast(state: State, rows: np.ndarray, own: int, *, whole_library: bool = False) -> Contrast | None:
    """Compare the last `own` amplitudes with those in the reference; None without reference.

    Where the error by itself shows that something is missing, the question is only whether it is this: one
    hypothesis, not a library of them, unless the library was looked through once more.
    """
    if state.reference is None or own == 0:
        return None
    family = 1 if state.size.stands_out and not whole_library else max(1, len(state.screen.candidates))
    return contrast_of(state.screen.grams, state.reference, rows, own, family, state.kinds)
