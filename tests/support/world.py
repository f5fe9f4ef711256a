"""A world without engine: points move by smooth fields, in amounts that the laws of the world give."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from plop.diagnosis.decision.conclusion import Conclusion
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.responses.job import Answer, Job
from plop.diagnosis.responses.table import Measured
from plop.physics.effects.library import EffectType, library
from plop.tracking.episode import Episode
from tests.support.coarse_episodes import BASE, coarse_episode

NOISE_M = 1e-4


class World(ABC):
    """Runs jobs; a subclass says how much of which field its laws are."""

    def __init__(self) -> None:
        self.ran = 0

    @abstractmethod
    def amounts(self, values: dict[str, float]) -> list[float]:
        """Turn amplitudes, by effect or, for a tilt, by amplitude, into amounts of fields."""

    def plain(self, episode: Episode) -> np.ndarray:
        return np.repeat(self.start(episode)[None], len(episode.times), 0)

    def start(self, episode: Episode) -> np.ndarray:
        return np.asarray(episode.points[0], float)

    def motion(self, name: str) -> int:
        """Number of the motion of an episode; each has its own unless a subclass says otherwise."""
        return int(name[-3:])

    def fields(self, episode: Episode, number: int) -> np.ndarray:
        """Displacement by one unit, of order 1 mm, growing in time; alike in all episodes, [T, M, 3]."""
        law, own = np.random.default_rng([number]), np.random.default_rng([self.motion(episode.name), number])
        places = (self.start(episode) - self.start(episode).mean(0)) / 0.02
        ramp = np.linspace(0, 1, len(episode.times)) ** (law.uniform(0.5, 2) * own.uniform(0.8, 1.2))
        shift, strain = (law.normal(0, 1, size) + 0.4 * own.normal(0, 1, size) for size in (3, (3, 3)))
        return 1e-3 * ramp[:, None, None] * (shift + places @ strain)

    def moved(self, episode: Episode, values: dict[str, float]) -> np.ndarray:
        total = self.plain(episode)
        for number, amount in enumerate(self.amounts(values)):
            total = total + amount * self.fields(episode, number)
        return total

    def run(self, jobs: list[Job]) -> list[Answer]:
        self.ran += len(jobs)
        return [
            Answer(
                self.moved(
                    job.episode, {c.amplitude if c.effect == "tilt" else c.effect: value for c, value in job.settings}
                )
            )
            for job in jobs
        ]

    def measured(self, seed: int, hidden: dict[str, float]) -> Measured:
        episodes = []
        for k in range(6):
            like = replace(coarse_episode(k % 2), name=f"box_{10 * seed + k:03d}", seen=None)
            poses = like.tool.world_from_tool.copy()
            poses[:, :3, 3] += np.random.default_rng(self.motion(like.name)).normal(0, 0.01, 3)
            like = replace(like, tool=replace(like.tool, world_from_tool=poses))
            noise = np.random.default_rng([seed, k]).normal(0, NOISE_M, like.points.shape)
            points = self.moved(like, hidden) + noise
            points[0] = self.start(like)
            episodes.append(replace(like, points=points, noise_m=NOISE_M))
        return Measured(episodes)

    def diagnosed(
        self, hidden: dict[str, float], laws: Iterable[str], types: dict[str, EffectType] | None = None
    ) -> Conclusion:
        """Hide something in one set of episodes, nothing in the reference, and diagnose."""
        return diagnose(
            self.measured(1, hidden), BASE, types or library(), self.run, reference=self.measured(2, {}), effects=laws
        )
