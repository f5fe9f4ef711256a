"""How far the diagnosing engine's response to a hidden law is off, where the truth is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from plop.diagnosis.hypotheses import Column
from plop.diagnosis.responses import Job
from plop.diagnosis.runs import Runs
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.tracking.episode import Episode


def response_error(
    effect: Effect, episodes: list[Episode], plain: list[Episode], members: Sequence[EngineBase], runs: Runs
) -> dict[str, float] | None:
    """Compare the engine's mean response at the true amplitude with the true one.

    Args:
        effect: What was hidden.
        episodes: With it.
        plain: The same points without it.
        members: Discretisations of the diagnosing engine; those that are unstable are left out.
        runs: Carries runs out.

    Returns:
        "size": length of the engine's response over that of the true one; "cosine" between the two. None where
        no discretisation is stable.
    """
    shapes = tuple((p.name, effect[p.name]) for p in effect.shapes)
    settings = tuple(
        (Column(effect.name, p.name, p.unit, shapes, effect[p.name], p.low, p.high), effect[p.name])
        for p in effect.amplitudes
    )
    found = [change for member in members if (change := _response(member, settings, episodes, runs)) is not None]
    if not found:
        return None
    own = np.mean(found, 0)
    true = np.concatenate([_change(e, e.points, p.points) for e, p in zip(episodes, plain, strict=True)])
    lengths = float(np.linalg.norm(own)), float(np.linalg.norm(true))
    return {"size": lengths[0] / lengths[1], "cosine": float(own @ true) / (lengths[0] * lengths[1])}


def _response(
    member: EngineBase, settings: tuple[tuple[Column, float], ...], episodes: list[Episode], runs: Runs
) -> np.ndarray | None:
    """Compute what a law changes in all episodes, one after the other; None where a run is unstable."""
    answers = runs([Job(episode, member, given) for given in (settings, ()) for episode in episodes])
    moved = [answer.points for answer in answers if answer.points is not None]
    if len(moved) < len(answers):
        return None
    pairs = zip(episodes, moved[: len(episodes)], moved[len(episodes) :], strict=True)
    return np.concatenate([_change(episode, after, before) for episode, after, before in pairs])


def _change(episode: Episode, after: np.ndarray, before: np.ndarray) -> np.ndarray:
    return episode.pooled((after - after[:1]) - (before - before[:1])).ravel()
