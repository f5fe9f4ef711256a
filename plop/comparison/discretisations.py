"""The engine as a base: its mean over several discretisations, and how unsure it is where these differ.

Which particles happen to lie at a tool's edge decides how an object slips and turns along it. That is chance of the
discretisation, not physics: the same engine with its particles closer together or farther apart differs by about as
much as it misses in motions that nothing is missing from. The mean of several misses less, and where they differ
their scatter tells how far it may be off, in motions that no reference recording holds, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plop.comparison.engine_run import predict_points, start_particles
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.tracking.episode import Episode

OTHERS = (0.86, 1.16)
"""Distances of the particles beside the engine's own, in units of it: 3.4 times its cost together."""


def discretised(base: EngineBase) -> list[EngineBase]:
    """Give the engine and the same with its particles, and cells, closer together and farther apart."""
    return [base, *(replace(base, spacing_m=share * base.spacing_m) for share in OTHERS)]


def predicted_by_each(base: EngineBase, episode: Episode, effects: Sequence[Effect]) -> list[np.ndarray]:
    """Run the engine in each discretisation; one of the others that is unstable is left out.

    Args:
        base: The engine's settings.
        episode: The episode.
        effects: Laws that act besides the material's own.

    Returns:
        The followed points, [T, M, 3] [m] each; those of the engine itself come first.

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
