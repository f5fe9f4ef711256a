"""What has been computed on the way to a verdict: evidence, the screen over it, and the same in the reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from plop.diagnosis.amplitude import STRONGEST_RESPONSE, parameters_of
from plop.diagnosis.candidates import BASE_COLUMNS, Candidate, Column
from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.evidence import Evidence, MisfitModel, Whitened, corrected, whiten
from plop.diagnosis.profile import Profile
from plop.diagnosis.regression import Grams, fit, known_misfit, solve
from plop.diagnosis.responses import Settings
from plop.diagnosis.screen import Score, Screen, one_per_effect
from plop.diagnosis.table import Table
from plop.diagnosis.variants import as_good
from plop.errors import PlopError
from plop.parameters import Estimate


class State:
    """Everything computed so far: evidence, screen, and the same columns in the reference recordings."""

    profiles: Mapping[str, Profile]
    """Column -> error and response over its amplitude; none where they are not known."""

    def __init__(self, tables: list[Table], candidates: list[Candidate]) -> None:
        """Whiten and multiply out.

        Args:
            tables: Measured episodes and, where there is one, the reference.
            candidates: The hypotheses.
        """
        self.tables, self.profiles = tables, {}
        self.evidence = tables[0].evidence()
        self.control: list[Evidence] = tables[1].evidence() if len(tables) > 1 else []
        if not self.control:  # the misfit then holds what is missing, which follows the motion, not the engine's doubt
            self.evidence = [replace(e, spread_m=np.zeros_like(e.spread_m)) for e in self.evidence]
        gone = {key for table in tables for key in table.dropped}
        usable = [c for c in candidates if not gone & {column.key for column in c.columns}]
        self.keys = list(dict.fromkeys(column.key for c in usable for column in c.columns))
        if not self.keys:
            raise PlopError(
                "The engine can compute no response.",
                found="; ".join(gone)[:300],
                fix="Calibrate the engine to recordings of this object: `plop identify`.",
            )
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

    def judged(self) -> list[Score]:
        """Score every effect, best first, by its best setting inside its range."""
        return one_per_effect(self._all_inside)

    @cached_property
    def _all_inside(self) -> list[Score]:
        return sorted(map(self._inside, self.scores()), key=lambda score: -score.gain)

    def _inside(self, score: Score) -> Score:
        """Take away what a law gains from an amplitude beyond its range, unless the engine may respond too weakly."""
        columns = score.candidate.columns
        if not any(parameter.at_bound for parameter in parameters_of(columns, score.fit, self.profiles).values()):
            return score
        ends = STRONGEST_RESPONSE * np.array([(column.low, column.high) for column in columns]).T
        values = np.clip(score.values, *ends)
        sizes = [abs(v) * self.response_rms_m(c.key) for v, c in zip(values, columns, strict=True)]
        return replace(self.screen.held(score, values), size_m=float(np.hypot.reduce(sizes)))

    def response_rms_m(self, key: str) -> float:
        """RMS displacement by one unit of a column over all episodes [m]."""
        squares = [(e.responses[key] ** 2).sum(-1).mean() for e in self.evidence]
        return float(np.sqrt(np.mean(squares)))

    def errors(self) -> np.ndarray:
        """Mean squared whitened residual of each episode without any candidate, [E]."""
        return self.screen.before() / [e.count for e in self.screen.episodes]

    @cached_property
    def size(self) -> ErrorSize:
        """How large the base's error is, against the reference's."""
        raw = float(self.screen.grams.energy.sum() / self.numbers)
        return ErrorSize.of(self.errors(), raw, self.floors, self.kinds)

    def would_stand_out(self, before: np.ndarray) -> bool:
        """Tell whether such held-out sums of squares [E] would show by themselves that something is missing."""
        errors = before / [e.count for e in self.screen.episodes]
        return ErrorSize.of(errors, float(errors.mean()), self.floors, self.kinds).stands_out

    @property
    def kinds(self) -> tuple[Sequence[str], Sequence[str]]:
        """Kind of motion of every episode, and of every one of the reference."""
        return self.tables[0].kinds, self.tables[1].kinds if self.control else []

    def left(self, score: Score) -> float:
        """Mean squared whitened held-out residual with an effect."""
        return float(score.after.sum() / self.numbers)

    @cached_property
    def energy(self) -> float:
        """Sum of squares that is left without any law, the base's own parameters refitted."""
        left = self._without_base(np.concatenate([e.residual for e in self.screen.episodes]))
        return float(left @ left)

    def measure(self, wanted: Sequence[tuple[Column, float]]) -> list[tuple[float, float] | None]:
        """Run columns at some amplitudes, see `profiles_of`; the base's own parameters are refitted to what is left."""
        both = self._runs([((column, amplitude),) for column, amplitude in wanted])
        return [
            None if found is None else (float(found[0] @ found[0]), float(found[1] @ found[1]) ** 0.5) for found in both
        ]

    def left_with(self, wanted: Sequence[Settings]) -> list[np.ndarray | None]:
        """Give the residuals with a law at some amplitudes, see `least_together`."""
        return [None if found is None else found[0] for found in self._runs(wanted)]

    def _runs(self, wanted: Sequence[Settings]) -> list[tuple[np.ndarray, np.ndarray] | None]:
        """Residual that is left and response of the engine, whitened, all episodes in a row, [D] each."""
        return [
            None if change is None else self._refitted(settings[0][0].key, change)
            for settings, change in zip(wanted, self.tables[0].changes(wanted), strict=True)
        ]

    def _refitted(self, key: str, change: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        evidence = self.tables[0].evidence([{key: points} for points in change])
        response = np.concatenate([whiten(e, self.misfit, [key]).matrix[0] for e in evidence])
        left = np.concatenate([e.residual for e in self.screen.episodes]) - response
        return self._without_base(left, besides=key), response

    def _without_base(self, left: np.ndarray, besides: str = "") -> np.ndarray:
        """Take off whitened residuals [D] what the base's own parameters can do, but for one of them."""
        others = np.array([k for k in self.screen.base if self.keys[k] != besides], int)
        matrix = np.concatenate([e.matrix[others] for e in self.screen.episodes], 1)
        return left - solve(matrix @ matrix.T, matrix @ left) @ matrix

    def settings(self, score: Score) -> list[Score]:
        """Give the other settings of a law, a time or a direction, that do as well as the one that was taken."""
        return as_good(score, self._all_inside)

    def amplitudes(self, score: Score) -> dict[str, Estimate]:
        """Give a law's amplitudes with their intervals, as a finding has them."""
        return parameters_of(score.candidate.columns, score.fit, self.profiles)

    def base_values(self) -> dict[str, np.ndarray]:
        """Fitted changes of the base's own parameters, by candidate; none without such parameters."""
        if not len(self.screen.base):
            return {}
        values = iter(fit(self.screen.grams, self.screen.base).values)
        return {c.key: np.array([next(values) for _ in c.columns]) for c in self.base_candidates}
