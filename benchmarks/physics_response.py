"""How far the diagnosing engine's response to a hidden law is off, where the truth is known."""

from __future__ import annotations

import numpy as np

from plop.diagnosis.candidates import Column
from plop.diagnosis.episode import Episode
from plop.diagnosis.responses import Job
from plop.diagnosis.runs import Runs
from plop.physics.effects.effect import Effect
from plop.physics.filled import EngineBase


def response_error(
    effect: Effect, episodes: list[Episode], plain: list[Episode], base: EngineBase, runs: Runs
) -> dict[str, float] | None:  # fmt: skip
    """Compare the engine's response at the true amplitude with the true one.

    Args:
        effect: What was hidden.
        episodes: With it.
        plain: The same points without it.
        base: The diagnosing engine.
        runs: Carries runs out.

    Returns:
        "size": length of the engine's response over that of the true one; "cosine" between the two. None where
        the engine is unstable.
    """
    shapes = tuple((p.name, effect[p.name]) for p in effect.shapes)
    settings = tuple((Column(effect.name, p.name, p.unit, shapes, effect[p.name], p.low, p.high), effect[p.name])
                     for p in effect.amplitudes)  # fmt: skip
    answers = runs([Job(episode, base, given) for given in (settings, ()) for episode in episodes])
    if any(answer.points is None for answer in answers):
        return None
    moved = [answer.points for answer in answers if answer.points is not None]
    true = np.concatenate([_change(e, e.points, p.points) for e, p in zip(episodes, plain, strict=True)])
    own = np.concatenate([_change(e, a, b)
                          for e, a, b in zip(episodes, moved, moved[len(episodes) :], strict=False)])  # fmt: skip
    lengths = float(np.linalg.norm(own)), float(np.linalg.norm(true))
    return {"size": lengths[0] / lengths[1], "cosine": float(own @ true) / (lengths[0] * lengths[1])}


def _change(episode: Episode, after: np.ndarray, before: np.ndarray) -> np.ndarray:
    return episode.pooled((after - after[:1]) - (before - before[:1])).ravel()
