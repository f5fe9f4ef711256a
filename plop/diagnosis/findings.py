"""Scores turned into findings: parameters with units and intervals, p, and the contrast with the reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import t as student

from plop.diagnosis.candidates import BASE_COLUMNS, Candidate, Column
from plop.diagnosis.contrast import Contrast, contrast_of
from plop.diagnosis.evidence import Evidence, MisfitModel, Whitened, corrected, whiten
from plop.diagnosis.regression import Fit, Grams, fit, gain, held_out_energy, known_misfit
from plop.diagnosis.screen import Score, Screen
from plop.diagnosis.shams import p_value
from plop.diagnosis.table import Table
from plop.diagnosis.verdict import Finding, stands_out
from plop.errors import PlopError


class State:
    """Everything computed so far: evidence, screen, and the same columns in the reference recordings."""

    def __init__(self, tables: list[Table], candidates: list[Candidate]) -> None:
        """Whiten and multiply out.

        Args:
            tables: Measured episodes and, where there is one, the reference.
            candidates: The hypotheses.
        """
        self.tables = tables
        self.evidence = tables[0].evidence()
        self.control: list[Evidence] = tables[1].evidence() if len(tables) > 1 else []
        gone = {key for table in tables for key in table.dropped}
        usable = [c for c in candidates if not gone & {column.key for column in c.columns}]
        self.keys = list(dict.fromkeys(column.key for c in usable for column in c.columns))
        if not self.keys:
            raise PlopError("The engine can compute no response.", found="; ".join(gone)[:300],
                            fix="Calibrate the engine to recordings of this object: `plop identify`.")  # fmt: skip
        self.misfit = MisfitModel.of(self.control or self.evidence)
        self.known, self.floors = np.zeros(len(self.keys)), np.zeros(0)
        if self.control:
            plain = [whiten(e, self.misfit, self.keys) for e in self.control]
            trial = Screen(plain, self.keys, usable)
            groups = [trial.columns(c) for c in trial.candidates]
            self.known, _ = known_misfit(trial.grams, trial.base, groups)
            self.misfit = MisfitModel.of([corrected(e, self.keys, self.known) for e in self.control])
            again = Screen([whiten(e, self.misfit, self.keys) for e in self.control], self.keys, usable)
            _, left = known_misfit(again.grams, again.base, groups)
            self.floors = left / [e.count for e in again.episodes]
        whitened = self._whitened(self.evidence)
        self.screen = Screen(whitened, self.keys, usable)
        self.base_candidates = [c for c in usable if c.effect in BASE_COLUMNS]
        self.reference = Grams.of(self._whitened(self.control)) if self.control else None
        self.numbers = sum(e.count for e in whitened)

    def _whitened(self, episodes: list[Evidence]) -> list[Whitened]:
        return [whiten(corrected(e, self.keys, self.known), self.misfit, self.keys) for e in episodes]

    def scores(self) -> list[Score]:
        """Score all candidates, best first."""
        return self.screen.scores(self.response_rms_m)

    def response_rms_m(self, key: str) -> float:
        """RMS displacement by one unit of a column over all episodes [m]."""
        squares = [(e.responses[key] ** 2).sum(-1).mean() for e in self.evidence]
        return float(np.sqrt(np.mean(squares)))

    def errors(self) -> np.ndarray:
        """Mean squared whitened residual of each episode, base parameters fitted to the others, [E]."""
        return self.screen.before() / [e.count for e in self.screen.episodes]

    def raw_error(self) -> float:
        """Mean squared whitened residual of the base as it is."""
        return float(self.screen.grams.energy.sum() / self.numbers)

    def excess(self) -> float | None:
        """How much larger the error is than in the reference, in standard errors (Welch, of logarithms)."""
        if len(self.floors) < 2:
            return None
        ours, theirs = np.log(self.errors()), np.log(self.floors)
        error = np.sqrt(ours.var(ddof=1) / len(ours) + theirs.var(ddof=1) / len(theirs))
        return float((ours.mean() - theirs.mean()) / max(error, 1e-12))

    def excess_p(self) -> float | None:
        """Chance that dealing the episodes out anew makes the difference in mean error as large (Fisher 1935)."""
        return None if len(self.floors) < 2 else exchanged(self.errors(), self.floors)

    def left(self, score: Score) -> float:
        """Mean squared whitened held-out residual with an effect."""
        return float(score.after.sum() / self.numbers)

    def finding(self, score: Score, shams: np.ndarray) -> Finding:
        """Add parameters, intervals, p and contrast to a score."""
        columns = score.candidate.columns
        parameters = _parameters(columns, score.fit, len(self.screen.base))
        for name, value in columns[0].shapes:
            parameters[name] = {"value": value, "low": float("-inf"), "high": float("inf"), "unit": "",
                                "at_bound": False, "chosen": True}  # fmt: skip
        rows = np.concatenate([self.screen.base, self.screen.columns(score.candidate)])
        contrast = self._contrast(rows, len(columns), score.fit)
        return Finding(score.candidate.effect, score.candidate.kind, parameters, score.gain, score.gain_error,
                       p_value(score.gain, shams), contrast, _steady(self.screen.before(), score.after), score.alone,
                       self._apart(score))  # fmt: skip

    def beyond(self, best: Score, others: Sequence[Score], shams: np.ndarray) -> tuple[Finding, float] | None:
        """Find the law that explains most of what the best one leaves; its gain is a share of that.

        Args:
            best: What is taken as given.
            others: Further laws.
            shams: Best gains under shams.

        Returns:
            The finding, with its amplitude fitted together with the best one's, and the mean squared residual
            with both; None without further laws.
        """
        given = np.concatenate([self.screen.base, self.screen.columns(best.candidate)])
        before = held_out_energy(self.screen.grams, given)
        found: list[tuple[Finding, float]] = []
        for other in others:
            columns = other.candidate.columns
            rows = np.concatenate([given, self.screen.columns(other.candidate)])
            after, fitted = held_out_energy(self.screen.grams, rows), fit(self.screen.grams, rows)
            won = gain(before, after)
            finding = Finding(
                other.candidate.effect, other.candidate.kind, _parameters(columns, fitted, len(given)), won,
                self.screen.gain_error(given, rows), p_value(won, shams),
                self._contrast(rows, len(columns), fitted, family=len(self.screen.candidates)),
                _steady(before, after),
            )  # fmt: skip
            found.append((finding, float(after.sum() / self.numbers)))
        return max(found, key=lambda pair: pair[0].gain, default=None)

    def base_finding(self, shams: np.ndarray) -> Finding:
        """Judge a change of the base's own parameters, against leaving them as they are."""
        raw, refitted = self.screen.grams.energy, self.screen.before()
        rows = self.screen.base
        fitted = fit(self.screen.grams, rows)
        columns = [column for c in self.base_candidates for column in c.columns]
        improvement, error = gain(raw, refitted), self.screen.gain_error(np.array([], int), rows)
        contrast = self._contrast(rows, len(rows), fitted)
        # The same kind of p as for effects: sham gains are shares of the error, too.
        return Finding("stiffness", "base", _parameters(tuple(columns), fitted, 0), improvement, error,
                       p_value(improvement, shams), contrast, alone=improvement)  # fmt: skip

    def _apart(self, score: Score) -> float:
        """Standard error of the difference in held-out error, an effect alone against the base's parameters alone."""
        error = self.screen.gain_error(self.screen.base, self.screen.columns(score.candidate))
        return error * float(self.screen.before().sum() / max(self.screen.grams.energy.sum(), 1e-30))

    def base_values(self) -> dict[str, np.ndarray]:
        """Fitted changes of the base's own parameters, by candidate; none without such parameters."""
        if not len(self.screen.base):
            return {}
        values = iter(fit(self.screen.grams, self.screen.base).values)
        return {c.key: np.array([next(values) for _ in c.columns]) for c in self.base_candidates}

    def least_amplitude(self, score: Score) -> float:
        """Amplitude of a score's first column that is as far from the reference as a named one must be."""
        rows = np.concatenate([self.screen.base, self.screen.columns(score.candidate)])
        contrast = self._contrast(rows, len(score.candidate.columns), score.fit)
        return 0.0 if contrast is None else contrast.least

    def _contrast(self, rows: np.ndarray, own: int, fitted: Fit, family: int | None = None) -> Contrast | None:
        """Compare the last `own` amplitudes with those in the reference; None without reference.

        Where the error by itself shows that something is missing, the question is only whether it is this: one
        hypothesis, not a library of them, unless `family` says otherwise.
        """
        if self.reference is None or own == 0:
            return None
        known = stands_out(float(self.errors().mean()), float(self.floors.mean()), self.excess(), self.excess_p())
        return contrast_of(fitted, fit(self.reference, rows), own,
                           family or (1 if known else len(self.screen.candidates)))  # fmt: skip


DEALS = 4000


def exchanged(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Permutation test of mean(ours) > mean(theirs): (1 + deals with as large a difference) / (1 + deals)."""
    both, count = np.concatenate([ours, theirs]), len(ours)
    order = np.argsort(np.random.default_rng(0).random((DEALS, len(both))), axis=1)[:, :count]
    dealt = both[order].sum(1)
    return float((1 + (dealt >= ours.sum() * (1 - 1e-12)).sum()) / (1 + DEALS))


def _steady(before: np.ndarray, after: np.ndarray) -> float:
    """Gain over all episodes but the one that gains most [-]: what misleads in one motion does not count."""
    rest = np.arange(len(before)) != np.argmax(before - after)
    return gain(before[rest], after[rest])


def _parameters(columns: tuple[Column, ...], fitted: Fit, first: int) -> dict[str, dict[str, Any]]:
    """Give values with 95 % intervals over episodes, and whether they are at the end of their range."""
    found = {}
    width = student.ppf(0.975, max(fitted.episodes - 1, 1))
    for k, column in enumerate(columns):
        value, error = fitted.values[first + k], float(np.sqrt(fitted.spread[first + k, first + k]))
        at_bound = value >= column.high or value <= column.low and column.low != 0
        found[column.amplitude] = {
            "value": float(np.clip(value, column.low, column.high)), "low": float(value - width * error),
            "high": float(value + width * error), "unit": column.unit, "at_bound": bool(at_bound or value < column.low),
        }  # fmt: skip
    return found
