"""The table of evidence: residuals of all episodes, and the responses of hypotheses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plop.comparison.discretisations import discretised
from plop.diagnosis.evidence.evidence import Evidence, evidence_of
from plop.diagnosis.responses.hypotheses import Hypothesis
from plop.diagnosis.responses.job import Answer, Job
from plop.diagnosis.responses.response_table import ResponseTable, RunJobs
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.tracking.episode import Episode
from plop.tracking.phases import motion_kind


@dataclass(frozen=True)
class Measured:
    """Episodes, with the base's prediction of each where the base is not the engine."""

    episodes: list[Episode]
    predictions: Mapping[str, Sequence[np.ndarray]] | None = None
    """Episode -> the followed points as the base predicts them, [T, M, 3] [m] each, several where it is an engine;
    None: the engine is the base."""


class Table:
    """Evidence of one set of episodes."""

    def __init__(
        self, measured: Measured, base: EngineBase, run_jobs: RunJobs, survey: EngineBase | None = None
    ) -> None:
        """Run the engine without effects; episodes that it cannot follow are dropped.

        Args:
            measured: The episodes.
            base: The engine.
            run_jobs: How it is run.
            survey: The same with few particles, for responses that need not be exact.

        Raises:
            PlopError: The engine can follow no episode.
        """
        self.base, self.run_jobs, self.dropped = base, run_jobs, dict[str, str]()
        coarse = [] if survey is None else [survey]
        members = discretised(base) if measured.predictions is None else [base]
        answers = iter(run_jobs([Job(e, member) for e in measured.episodes for member in (*coarse, *members)]))
        self.episodes: list[Episode] = []
        self.plain: list[list[np.ndarray]] = []
        first, rough = list[Answer](), list[Answer]()
        for episode in measured.episodes:
            surveyed = [next(answers) for _ in coarse]
            own, *others = [next(answers) for _ in members]
            if own.points is None:
                self.dropped[episode.name] = own.trouble
                continue
            self.episodes.append(episode)
            first.append(own)
            rough += surveyed
            self.plain.append([own.points, *(other.points for other in others if other.points is not None)])
        if not self.episodes:
            raise PlopError(
                "The engine can follow no episode.",
                found="; ".join(self.dropped.values())[:300],
                fix="Calibrate the engine to recordings of this object: `plop identify`.",
            )
        self._given = measured.predictions
        self.full = ResponseTable(base, self.episodes, first, run_jobs)
        self.survey = self.full
        """The same as `full` where there is none, or it cannot follow an episode that the engine follows."""
        if survey is not None and all(answer.points is not None for answer in rough):
            self.survey = ResponseTable(survey, self.episodes, rough, run_jobs)

    @cached_property
    def evidence(self) -> list[Evidence]:
        """Everything about the episodes that no law changes; an engine as base says its mean over discretisations."""
        given = self._given
        return [
            evidence_of(episode, plain if given is None else given[episode.name])
            for episode, plain in zip(self.episodes, self.plain, strict=True)
        ]

    @cached_property
    def kinds(self) -> list[str]:
        """Kind of motion of every episode."""
        return [motion_kind(episode) for episode in self.episodes]

    @property
    def failed(self) -> dict[str, str]:
        """Runs that are unstable in some episode, with the reason."""
        return {**self.survey.failed, **self.full.failed}

    def respond(self, hypotheses: Sequence[Hypothesis]) -> None:
        """Run what has not been run yet."""
        for coarse, responses in ((True, self.survey), (False, self.full)):
            responses.respond(settings for h in hypotheses if h.coarse == coarse for settings, _ in h.runs)

    def repeat(self, k: int, other: Table, its: int) -> None:
        """Take what laws change in an episode from another one of the same motion, see `ResponseTable.repeat`."""
        self.full.repeat(k, other.full, its)
        if self.survey.base == other.survey.base:
            self.survey.repeat(k, other.survey, its)

    def trouble(self, hypothesis: Hypothesis) -> str | None:
        """Say why a hypothesis cannot be judged; None where all its runs are there."""
        return self._of(hypothesis).trouble(hypothesis)

    def response(self, hypothesis: Hypothesis) -> list[np.ndarray]:
        """Give what a hypothesis changes in every episode, [F, K, 3] [m] each."""
        return self._of(hypothesis).response(hypothesis)

    def _of(self, hypothesis: Hypothesis) -> ResponseTable:
        return self.survey if hypothesis.coarse else self.full
