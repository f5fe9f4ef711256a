"""The engine as a base: its mean over several discretisations, and its uncertainty from their spread.

Which particles happen to lie at a tool's edge affects how an object slips and turns along it. That is an artefact of
the discretisation, not physics: the same engine with a finer or coarser particle spacing differs by about as much as
its own error in motions without missing physics. The mean of several discretisations has a smaller error, and their
spread estimates this error, also in motions that no reference recording contains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from trimesh.triangles import area, mass_properties

from plop.comparison.engine_run import predict_points, start_particles
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.tracking.episode import Episode

OTHERS = (0.86, 1.16)
"""Further particle spacings, relative to the engine's own; together they cost 3.4 times as much."""


def spacing_for(episodes: list[Episode], particles: int) -> float:
    """Choose a distance of particles so that about so many fill the object [m].

    There is one for each cell and, since the outer ones lie on the surface, half a one more for each cell face there.
    """
    found = []
    for episode in episodes:
        triangles = episode.vertices[episode.faces]
        volume, surface = abs(mass_properties(triangles).volume), float(area(triangles).sum())
        found.append(max(np.roots([particles, 0, -surface / 2, -volume]).real.tolist()))
    return round(float(np.median(found)), 5)


def discretised(base: EngineBase) -> list[EngineBase]:
    """Return the engine and the same with its particles, and cells, closer together and farther apart."""
    return [base, *(replace(base, spacing_m=share * base.spacing_m) for share in OTHERS)]


def predicted_by_each(base: EngineBase, episode: Episode, effects: Sequence[Effect] = ()) -> list[np.ndarray]:
    """Run the engine in each discretisation; unstable ones other than its own are left out.

    Args:
        base: The engine's settings.
        episode: The episode.
        effects: Laws in addition to the base material.

    Returns:
        The tracked points, [T, M, 3] [m] each; those of the engine itself come first.

    Raises:
        PlopError: The engine itself is unstable.
    """
    found = []
    for member in discretised(base):
        try:
            found.append(predict_points(member, episode, start_particles(member, episode, effects), effects))
        except PlopError:
            if not found:
                raise
    return found
