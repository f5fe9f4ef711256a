"""Run the engine through an episode from its first frame and read the tracked points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plop.physics.adapters.filled import EngineBase, filled_particles
from plop.physics.effects.effect import Effect
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.physics.engine.time_step import STEP_RATIO
from plop.tracking.episode import Episode


def start_particles(base: EngineBase, episode: Episode, effects: Sequence[Effect] = ()) -> Particles:
    """Fill the object at an episode's first frame; one tracer for each measured point comes last."""
    return filled_particles(base, (episode.vertices, episode.faces), episode.points[0], episode.table_z_m, effects)


def predict_points(base: EngineBase, episode: Episode, start: Particles, effects: Sequence[Effect] = ()) -> np.ndarray:
    """Run the engine through an episode; see `run_points`."""
    return run_points(base, episode, start, effects)[0]


def run_points(
    base: EngineBase, episode: Episode, start: Particles, effects: Sequence[Effect] = (), most_step_s: float = np.inf
) -> tuple[np.ndarray, float]:
    """Run the engine through an episode.

    Args:
        base: The engine's settings.
        episode: The episode.
        start: See `start_particles`.
        effects: Laws in addition to the base material.
        most_step_s: Longest time step [s]; where it is not stable, it is divided by a power of STEP_RATIO.

    Returns:
        The tracked points, [T, M, 3] [m], and the time step [s].

    Raises:
        PlopError: The run is unstable.
    """
    config = replace(base.config, table_z_m=episode.table_z_m)
    tool, times = episode.tool, episode.times
    run = simulate(
        start, base.material, tool, times, config, effects=effects, most_step_s=most_step_s, step_ratio=STEP_RATIO
    )
    return run.positions[:, -len(episode.patch) :].astype(np.float64), run.dt_s
