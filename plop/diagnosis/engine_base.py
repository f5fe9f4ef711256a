"""The engine in an episode: fill the object, let it carry its own weight, run it, read the points off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plop.diagnosis.episode import Episode
from plop.physics.config import EngineConfig
from plop.physics.effects.effect import Effect
from plop.physics.fill import fill_surface
from plop.physics.material import Material
from plop.physics.particles import Particles
from plop.physics.solver import simulate

SPACING_M = 0.006
"""Distance of the particles [m]."""
CELLS = 2.0
"""Edge of a grid cell, in distances of the particles."""
_TRACER = 1e-6
"""Volume of a followed point as a share of a particle's."""
_SETTLE_DAMPING_PER_S, _SETTLE_S, _SETTLE_ROUNDS = 60.0, 0.25, 2


@dataclass(frozen=True)
class EngineBase:
    """The engine's settings for one object, the same in all its episodes."""

    material: Material
    spacing_m: float = SPACING_M
    settled: bool = True
    """The object has carried its own weight before the first frame; else it is free of stress there."""
    table_cone: str = "round"
    """See EngineConfig."""

    @property
    def config(self) -> EngineConfig:
        """Grid and surroundings; the table's height is the episode's."""
        return EngineConfig(dx_m=CELLS * self.spacing_m, table_cone=self.table_cone)  # type: ignore[arg-type]


def start_particles(base: EngineBase, episode: Episode, effects: Sequence[Effect] = ()) -> Particles:
    """Fill the object at the first frame; one tracer for each measured point comes last.

    A settled object is under stress already. The stress is found by letting a guess of the unloaded shape
    sag, and moving the guess by what it sagged too far (a fixed-point iteration on the rest shape).

    Args:
        base: The engine's settings.
        episode: The episode.
        effects: Laws that have acted before the first frame, too.
    """
    filled, volumes = fill_surface(episode.vertices, episode.faces, base.spacing_m)
    tracers = np.full(len(episode.patch), _TRACER * base.spacing_m**3)
    wanted = np.concatenate([filled, episode.points[0]])
    particles = Particles(wanted, np.concatenate([volumes, tracers]))
    if not base.settled:
        return particles
    calm = replace(base.material, damping_per_s=_SETTLE_DAMPING_PER_S)
    config = replace(base.config, table_z_m=episode.table_z_m)
    floor = -np.inf if episode.table_z_m is None else episode.table_z_m + 1e-5
    guess = wanted.copy()
    for _ in range(_SETTLE_ROUNDS):
        run = simulate(replace(particles, positions=guess), calm, None, np.array([0, _SETTLE_S]), config,
                       effects=effects)  # fmt: skip
        guess = guess - (run.positions[-1] - wanted)
        guess[:, 2] = np.maximum(guess[:, 2], floor)
    run = simulate(replace(particles, positions=guess), calm, None, np.array([0, _SETTLE_S]), config, effects=effects)
    return replace(run.final, velocities=None, affine=None, memory=None)


def predict_points(
    base: EngineBase, episode: Episode, start: Particles, effects: Sequence[Effect] = ()
) -> np.ndarray:  # fmt: skip
    """Run the engine through an episode.

    Args:
        base: The engine's settings.
        episode: The episode.
        start: See `start_particles`.
        effects: Laws that act besides the material's own.

    Returns:
        The followed points, [T, M, 3] [m].

    Raises:
        PlopError: The run is unstable.
    """
    config = replace(base.config, table_z_m=episode.table_z_m)
    run = simulate(start, base.material, episode.tool, episode.times, config, effects=effects)
    return run.positions[:, -len(episode.patch) :].astype(np.float64)
