"""What laws change in the episodes of a set, as one engine computes it; each run is made once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property

import numpy as np

from plop.diagnosis.evidence.evidence import compared_frames, moved
from plop.diagnosis.responses.hypotheses import Hypothesis, Settings, run_key
from plop.diagnosis.responses.job import Answer, Job
from plop.geometry.meshes.tool import ToolGeometry
from plop.physics.adapters.filled import EngineBase
from plop.physics.engine.time_step import STEP_RATIO
from plop.physics.engine.tool_motion import ToolKind, kind_of
from plop.tracking.episode import Episode

RunJobs = Callable[[Sequence[Job]], list[Answer]]
"""Runs jobs in any order, in parallel, and gives their answers in the order of the jobs."""


class ResponseTable:
    """Responses of one engine in some episodes."""

    def __init__(
        self, base: EngineBase, episodes: Sequence[Episode], plain: Sequence[Answer], run_jobs: RunJobs
    ) -> None:
        """Begin with no law.

        Args:
            base: The engine.
            episodes: E of them.
            plain: What it answers without a law, one for each; it follows all of them.
            run_jobs: How it is run.
        """
        self.base, self.episodes, self.run_jobs = base, list(episodes), run_jobs
        self._plain = [np.asarray(answer.points) for answer in plain]
        self._steps_s = [answer.step_s for answer in plain]
        self._changes: dict[str, dict[int, np.ndarray]] = {}
        """Law -> what it changes in the episodes in which it was run, [F, K, 3] [m] each."""
        self._repeats: dict[int, tuple[ResponseTable, int]] = {}
        """Episode -> where the same motion was run, and its number there."""
        self._without: list[dict[int, np.ndarray]] = [
            {0: moved(episode, points)} for episode, points in zip(self.episodes, self._plain, strict=True)
        ]
        """Displacements without any law, by how much shorter the time steps are."""
        self.failed: dict[str, str] = {}
        """Runs that are unstable in some episode, with the reason."""

    def respond(self, wanted: Iterable[Settings]) -> None:
        """Run the engine with laws, what has not been run yet; a run that is unstable in an episode is not used.

        A law is compared with a run without it in the same time steps: where a law needs shorter ones, more of them
        dissipate more, which is not what it does, and what is about to slide slides after any small difference.
        """
        settings = {run_key(s): s for s in wanted}
        new = {key: s for key, s in settings.items() if key not in self._changes and key not in self.failed}
        jobs = {key: self.jobs(s) for key, s in new.items()}
        answers = iter(self.run_jobs([job for own in jobs.values() for job in own.values()]))
        found = {key: {k: next(answers) for k in own} for key, own in jobs.items()}
        for key, own in found.items():
            trouble = next((answer.trouble for answer in own.values() if answer.points is None), None)
            if trouble is not None:
                self.failed[key] = trouble
        stable = {key: own for key, own in found.items() if key not in self.failed}
        self._run_without(stable.values())
        for key, own in stable.items():
            self._changes[key] = {
                k: moved(self.episodes[k], np.asarray(answer.points)) - self._without[k][self._shorter(k, answer)]
                for k, answer in own.items()
            }

    def repeat(self, k: int, other: ResponseTable, its: int) -> None:
        """Take what laws change in an episode from another one, with the same motion, patches and number of frames.

        Args:
            k: The episode.
            other: Where the other one is; it is asked for the same laws.
            its: Its number there.
        """
        self._repeats[k] = other, its

    def jobs(self, settings: Settings) -> dict[int, Job]:
        """Give the runs of a law by episode; none of a repeat, nor where it acts at cuts and nothing is cut."""
        of_cuts = bool(settings) and all(column.needs_blade for column, _ in settings)
        return {
            k: Job(episode, self.base, settings, self._steps_s[k])
            for k, episode in enumerate(self.episodes)
            if k not in self._repeats and (self._blades[k] or not of_cuts)
        }

    @cached_property
    def _blades(self) -> list[bool]:
        tools = [ToolGeometry.from_mesh(episode.tool.vertices, episode.tool.faces) for episode in self.episodes]
        return [kind_of(tool) == ToolKind.BLADE for tool in tools]

    @cached_property
    def _seen(self) -> list[np.ndarray]:
        return [episode.seen_patches[compared_frames(len(episode.times))] for episode in self.episodes]

    def _shorter(self, k: int, answer: Answer) -> int:
        """Tell by how many times STEP_RATIO a run's time steps are shorter than without laws."""
        if not answer.step_s < self._steps_s[k]:
            return 0
        return round(float(np.log(self._steps_s[k] / answer.step_s) / np.log(STEP_RATIO)))

    def _run_without(self, answers: Iterable[Mapping[int, Answer]]) -> None:
        """Run the engine without laws in the time steps of some runs with laws."""
        wanted = {(k, self._shorter(k, answer)) for own in answers for k, answer in own.items()}
        new = sorted((k, shorter) for k, shorter in wanted if shorter not in self._without[k])
        steps = [self._steps_s[k] / STEP_RATIO**shorter for k, shorter in new]
        jobs = [Job(self.episodes[k], self.base, most_step_s=step) for (k, _), step in zip(new, steps, strict=True)]
        for (k, shorter), answer in zip(new, self.run_jobs(jobs), strict=True):
            points = self._plain[k] if answer.points is None else answer.points
            self._without[k][shorter] = moved(self.episodes[k], points)

    def trouble(self, hypothesis: Hypothesis) -> str | None:
        """Say why a hypothesis cannot be judged; None where all its runs are there."""
        return next((self.failed[key] for s, _ in hypothesis.runs if (key := run_key(s)) in self.failed), None)

    def response(self, hypothesis: Hypothesis) -> list[np.ndarray]:
        """Give what a hypothesis changes in every episode, [F, K, 3] [m] each."""
        found = []
        for k, seen in enumerate(self._seen):
            table, its = self._repeats.get(k, (self, k))
            found.append(seen[..., None] * sum(w * table.change(its, run_key(s)) for s, w in hypothesis.runs))
        return found

    def change(self, k: int, law: str) -> np.ndarray:
        """Give what a law that was run changes in an episode, whether a patch could be seen or not, [F, K, 3] [m]."""
        return self._changes[law].get(k, np.zeros_like(self._without[k][0]))
