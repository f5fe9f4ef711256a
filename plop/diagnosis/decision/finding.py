"""One law with its evidence, as it may be named: parameters with units and intervals, and why it is not named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from plop.diagnosis.decision.verdict import Reason
from plop.diagnosis.evidence.contrast import roots
from plop.diagnosis.rule import RULE, DecisionRule
from plop.diagnosis.scores.score import Score
from plop.parameters import Estimate

NO_HELP = "does not help"
"""What is said of a law that takes nothing of the held-out error away."""


def explained_text(gain: float, error: float) -> str:
    """Write the share of the held-out error that a law takes away with its standard error; never less than nothing."""
    if gain <= 0:
        return NO_HELP
    return f"{100 * gain:.1f} ± {100 * error:.1f} %" if error <= 1 else f"{100 * gain:.1f} % (± more than 100 %)"


@dataclass(frozen=True)
class Curve:
    """Size of a law's response over its amplitude, both in units of what was found there; in proportion unless known.

    What sticks, or holds, answers to a larger amplitude with little more: such amplitudes cannot be told apart.
    """

    points: tuple[tuple[float, float], ...] = ((1.0, 1.0),)
    """Amplitude and size of the response, sorted; one of them is (1, 1)."""

    def amplitude(self, size: float) -> float:
        """Give the amplitude that has a response of so much: beyond the last one, as the curve goes on there."""
        if size <= 0:
            return size
        multiples, sizes = np.array([(0.0, 0.0), *self.points]).T
        sizes = np.maximum.accumulate(sizes)
        if size <= sizes[-1]:
            return float(np.interp(size, sizes, multiples))
        slope = (sizes[-1] - sizes[-2]) / (multiples[-1] - multiples[-2])
        return float(multiples[-1] + (size - sizes[-1]) / slope) if slope > 0 else np.inf


@dataclass(frozen=True)
class Finding:
    """One law with its evidence."""

    name: str
    kind: str
    """physics, decoy or base."""
    parameters: Mapping[str, Estimate]
    score: Score
    gain: float
    """Share of the held-out squared error that it takes away [-]."""
    gain_error: float
    """Its standard error over episodes."""
    reasons: tuple[Reason, ...]
    """Why it is not named."""

    @property
    def at_bound(self) -> bool:
        """Tell whether a parameter ran into its range."""
        return Reason.AT_BOUND in self.reasons

    @property
    def stands(self) -> bool:
        """Tell whether it is there, if only as a part."""
        return {*self.reasons} <= {Reason.AT_BOUND}


def finding_of(score: Score, as_good: Sequence[Score], rule: DecisionRule = RULE, curve: Curve = Curve()) -> Finding:
    """Judge the best score of a law.

    Args:
        score: It.
        as_good: The same law's other settings that do as well.
        rule: Margins.
        curve: Size of its response over its amplitude.
    """
    columns = score.hypothesis.candidate.columns
    parameters = amplitudes_of(score, rule, curve)
    for other in as_good:
        for name, found in amplitudes_of(other, rule).items():
            own = parameters[name]
            parameters[name] = Estimate(
                own.value, min(own.low, found.low), max(own.high, found.high), own.unit, own.at_bound
            )
    units = dict(score.hypothesis.candidate.shape_units)
    for name, value in columns[0].shapes:
        also = sorted({dict(other.hypothesis.candidate.columns[0].shapes)[name] for other in as_good} - {value})
        parameters[name] = Estimate(value, unit=units.get(name, ""), alternatives=tuple(also), fitted=False)
    share, error = _share(*score.explained)
    return Finding(
        score.hypothesis.effect,
        score.hypothesis.candidate.kind,
        parameters,
        score,
        share,
        error,
        reasons_of(score, rule),
    )


def amplitudes_of(score: Score, rule: DecisionRule = RULE, curve: Curve = Curve()) -> dict[str, Estimate]:
    """Give amplitudes with their 95 % intervals, kept inside their ranges.

    What is known with some error is how much of the response there is; the curve turns its ends into amplitudes.
    """
    found = {}
    at_bound = score.amount >= score.hypothesis.most * (1 - 1e-9)
    size = max(float(np.linalg.norm(score.values)), 1e-12)
    chance = student.ppf(0.975, score.directed.freedom) * score.errors / size
    widths = np.hypot(chance, rule.response_width)
    for column, value, width in zip(score.hypothesis.candidate.columns, score.values, widths, strict=True):
        below, above = (curve.amplitude(1 + share) - 1 for share in (-float(width), float(width)))
        away = np.copysign(size, value)
        ends = sorted((value + below * away, value + above * away))
        # -0 is 0
        low, high, inside = (float(np.clip(v, column.low, column.high)) + 0.0 for v in (*ends, value))
        found[column.amplitude] = Estimate(inside, low, high, column.unit, bool(at_bound))
    return found


def reasons_of(score: Score, rule: DecisionRule = RULE) -> tuple[Reason, ...]:
    """Say which conditions for being named fail."""
    shown = roots(score.recorded)
    helps = float(shown.sum()) > 0
    failed = {
        Reason.CHANCE: score.p > rule.alarm,
        Reason.NO_HELP: not helps,
        Reason.ONE_EPISODE: helps and shown.sum() <= shown.max(),
        Reason.AT_BOUND: helps and score.amount >= score.hypothesis.most * (1 - 1e-9),
    }
    return tuple(reason for reason, holds in failed.items() if holds)


def worse(best: Score, other: Score, rule: DecisionRule = RULE) -> bool:
    """Tell whether a law explains episodes less well than the best one; see `gains_worse`."""
    return gains_worse(best.gains, other.gains, rule)


def gains_worse(best: np.ndarray, other: np.ndarray, rule: DecisionRule = RULE) -> bool:
    """Tell whether gains of episodes, of the reference, too, are worse than others.

    They are where the sum is less by more than chance between episodes, and by more than a response that is right in
    shape loses by being too strong or too weak. Compared are signed roots of the gains, so that the one episode that
    shows most does not decide alone (t test over episodes, one-sided).

    Args:
        best: Gain of each episode by the best law, [E] [nats].
        other: By another one.
        rule: Margins.
    """
    if other.sum() > rule.whole * best.sum():
        return False
    apart = roots(best) - roots(other)
    error = apart.std(ddof=1) / np.sqrt(len(apart))
    return bool(apart.mean() > student.ppf(1 - rule.alike, len(apart) - 1) * error + 1e-9)


def _share(without: np.ndarray, removed: np.ndarray) -> tuple[float, float]:
    """Share of the squared error that goes away, and its standard error (ratio estimator over episodes)."""
    total, count = float(without.sum()), len(without)
    share = float(removed.sum()) / max(total, 1e-300)
    apart = removed - share * without
    error = np.sqrt(count / max(count - 1, 1) * float((apart**2).sum())) / max(total, 1e-300)
    return share, float(error)
