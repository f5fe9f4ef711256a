"""The table of evidence: residuals of all episodes, and responses that can be computed anew at other amplitudes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plop.comparison.discretisations import discretised
from plop.diagnosis.candidates import Column
from plop.diagnosis.evidence import Evidence, evidence_of
from plop.diagnosis.responses import Answer, Job, Settings
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.tracking.episode import Episode
from plop.tracking.phases import motion_kind

RunJobs = Callable[[Sequence[Job]], list[Answer]]
"""Runs jobs in any order, in parallel, and gives their answers in the order of the jobs."""


@dataclass(frozen=True)
class Measured:
    """Episodes, with the base's prediction of each where the base is not the engine."""

    episodes: list[Episode]
    predictions: Mapping[str, Sequence[np.ndarray]] | None = None
    """Episode -> the followed points as the base predicts them, [T, M, 3] [m] each, several where it is an engine;
    None: the engine is the base."""


class Table:
    """Evidence of one set of episodes."""

    def __init__(self, measured: Measured, base: EngineBase, run_jobs: RunJobs) -> None:
        """Run the engine without effects; episodes that it cannot follow are dropped.

        Raises:
            PlopError: It can follow none.
        """
        self.base, self.run_jobs, self.dropped = base, run_jobs, dict[str, str]()
        answers = run_jobs([Job(episode, base) for episode in measured.episodes])
        self.episodes: list[Episode] = []
        self.plain: list[np.ndarray] = []
        for episode, answer in zip(measured.episodes, answers, strict=True):
            if answer.points is None:
                self.dropped[episode.name] = answer.trouble
            else:
                self.episodes.append(episode)
                self.plain.append(answer.points)
        if not self.episodes:
            raise PlopError(
                "The engine can follow no episode.",
                found="; ".join(self.dropped.values())[:300],
                fix="Calibrate the engine to recordings of this object: `plop identify`.",
            )
        self.given = measured.predictions
        self.responses: list[dict[str, np.ndarray]] = [{} for _ in self.episodes]

    @cached_property
    def elsewhere(self) -> list[list[np.ndarray | None]]:
        """What the engine's other discretisations predict without effects, by episode; None where one is unstable."""
        members = discretised(self.base)[1:]
        answers = iter(self.run_jobs([Job(episode, member) for episode in self.episodes for member in members]))
        return [[next(answers).points for _ in members] for _ in self.episodes]

    @cached_property
    def predictions(self) -> list[Sequence[np.ndarray]]:
        """What the base says, by episode; an engine as base says it in each discretisation."""
        if self.given is not None:
            return [self.given[episode.name] for episode in self.episodes]
        return [
            [own, *(points for points in others if points is not None)]
            for own, others in zip(self.plain, self.elsewhere, strict=True)
        ]

    @cached_property
    def kinds(self) -> list[str]:
        """Kind of motion of every episode."""
        return [motion_kind(episode) for episode in self.episodes]

    def respond(self, columns: Sequence[Column], *, everywhere: bool = False) -> None:
        """Compute the response of each column at its amplitude, per unit of it; replaces what was there.

        A column that makes the engine unstable in any episode is left out everywhere.

        Args:
            columns: What is computed.
            everywhere: In each discretisation, whose mean counts; another than the engine's own may be unstable.
        """
        wanted = [c for c in columns if c.key not in self.dropped]
        members = discretised(self.base) if everywhere else [self.base]
        jobs = [
            Job(episode, member, ((column, column.value),))
            for column in wanted
            for episode in self.episodes
            for member in members
        ]
        answers = iter(self.run_jobs(jobs))
        for column in wanted:
            own = [[next(answers) for _ in members] for _ in self.episodes]
            trouble = next((first.trouble for first, *_ in own if first.points is None), None)
            if trouble is not None:
                self.dropped[column.key] = trouble
            for k, each in enumerate(own):
                if trouble is not None:
                    self.responses[k].pop(column.key, None)
                    continue
                self.responses[k][column.key] = self._moved(k, each) / column.value

    def respond_together(self, columns: Sequence[Column], *, everywhere: bool = False) -> None:
        """Do the same for amplitudes of one law that act together: at their values the responses add up to the law's.

        What they do beyond the sum of what each does alone is shared out equally (of two: Shapley 1953). An object
        that is about to slide, for one, slides under a pull along x and one along y, and under neither alone.

        Args:
            columns: Of one law.
            everywhere: See `respond`.
        """
        self.respond(columns, everywhere=everywhere)
        if any(column.key in self.dropped for column in columns):
            return
        settings = tuple((column, column.value) for column in columns)
        members = discretised(self.base) if everywhere else [self.base]
        answers = iter(self.run_jobs([Job(e, member, settings) for e in self.episodes for member in members]))
        together = [[next(answers) for _ in members] for _ in self.episodes]
        trouble = next((first.trouble for first, *_ in together if first.points is None), None)
        for k, each in enumerate(together):
            if trouble is not None:
                for column in columns:
                    self.dropped[column.key] = trouble
                    self.responses[k].pop(column.key, None)
                continue
            beyond = self._moved(k, each) - sum(c.value * self.responses[k][c.key] for c in columns)
            for column in columns:
                self.responses[k][column.key] = self.responses[k][column.key] + beyond / (len(columns) * column.value)

    def _moved(self, number: int, answers: Sequence[Answer]) -> np.ndarray:
        """What runs of an episode changed, the mean over discretisations, the engine's own first, [T, M, 3] [m]."""
        plain = [self.plain[number], *(self.elsewhere[number] if len(answers) > 1 else [])]
        return np.mean(
            [a.points - p for a, p in zip(answers, plain, strict=True) if a.points is not None and p is not None], 0
        )

    def changes(self, wanted: Sequence[Settings]) -> list[list[np.ndarray] | None]:
        """Compute what laws change at some amplitudes.

        Returns:
            For each one the change of the prediction in every episode, [T, M, 3] [m]; None where one is unstable.
        """
        jobs = [Job(episode, self.base, settings) for settings in wanted for episode in self.episodes]
        answers = iter(self.run_jobs(jobs))
        found: list[list[np.ndarray] | None] = []
        for _ in wanted:
            points = [next(answers).points for _ in self.episodes]
            moved = [p - plain for p, plain in zip(points, self.plain, strict=True) if p is not None]
            found.append(moved if len(moved) == len(points) else None)
        return found

    def evidence(self, responses: Sequence[dict[str, np.ndarray]] | None = None) -> list[Evidence]:
        """Reduce everything to patches and compared frames; with other responses than the table's if given."""
        own = self.responses if responses is None else responses
        return [evidence_of(episode, self.predictions[k], own[k]) for k, episode in enumerate(self.episodes)]
