"""One engine run: the jobs that fill the cores, an episode with some laws each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plop.comparison.engine_run import run_points, start_particles
from plop.diagnosis.responses.hypotheses import Settings, run_key
from plop.errors import PlopError, UserCodeError
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import EffectType
from plop.tracking.episode import Episode


@dataclass(frozen=True)
class Job:
    """One engine run."""

    episode: Episode
    base: EngineBase
    settings: Settings = ()
    """Empty: the engine without effects."""
    most_step_s: float = np.inf
    """Longest time step, see `run_points` [s]."""

    @property
    def key(self) -> str:
        """What is added to the engine, e.g. "viscosity().viscosity_pa_s=12"."""
        return run_key(self.settings) + ("" if np.isinf(self.most_step_s) else f" dt_s<={self.most_step_s:.6g}")


@dataclass(frozen=True)
class Answer:
    """What a job gives."""

    points: np.ndarray | None
    """[T, M, 3] [m]; None when the run was unstable."""
    trouble: str = ""
    """Why not."""
    step_s: float = np.inf
    """Time step of the run [s]."""


def run_job(job: Job, types: Mapping[str, EffectType]) -> Answer:
    """Simulate one episode with some effects; an unstable run is an answer, not an error.

    Raises:
        UserCodeError: A law of the user's has a mistake.
    """
    effects = []
    for name in dict.fromkeys(column.effect for column, _ in job.settings):
        own = [(column, value) for column, value in job.settings if column.effect == name]
        values = {c.amplitude: float(np.clip(v, c.low, c.high)) for c, v in own}
        effects.append(types[name](**values, **dict(own[0][0].shapes)))
    try:
        start = start_particles(job.base, job.episode, effects)
        points, step_s = run_points(job.base, job.episode, start, effects, job.most_step_s)
        return Answer(points, step_s=step_s)
    except UserCodeError:
        raise
    except PlopError as error:
        return Answer(None, f"{error.problem} {error.where}: {error.found}")
