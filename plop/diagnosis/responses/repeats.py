"""Repeats of a motion: the same places of the object are compared in each, and a law changes the same in each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from plop.diagnosis.evidence.discrepancy import path_distances
from plop.diagnosis.evidence.evidence import compared_frames, foot_of, tool_path
from plop.diagnosis.evidence.noise import repeats_of
from plop.diagnosis.responses.response_table import RunJobs
from plop.diagnosis.responses.table import Measured, Table
from plop.physics.adapters.filled import EngineBase
from plop.tracking.episode import Episode


def tables_of(
    sets: Sequence[Measured], base: EngineBase, run_jobs: RunJobs, survey: EngineBase | None = None
) -> list[Table]:
    """Make the table of each set, in which repeats of a motion have the same patches and responses; see `Table`."""
    tables = [Table(each, base, run_jobs, survey) for each in with_shared_patches(*sets)]
    share_responses(tables)
    return tables


def with_shared_patches(*sets: Measured) -> list[Measured]:
    """Give repeats of a motion the patches of the first of them; other episodes keep their own."""
    episodes = [episode for each in sets for episode in each.episodes]
    found = list(episodes)
    for group in _repeats(episodes):
        for k in group[1:]:
            found[k] = _with_patches_of(episodes[k], episodes[group[0]])
    ends = np.cumsum([len(each.episodes) for each in sets])
    return [replace(each, episodes=found[end - len(each.episodes) : end]) for each, end in zip(sets, ends, strict=True)]


def share_responses(tables: Sequence[Table]) -> None:
    """Let repeats of a motion have the responses of the first of them: the engine is run once for each motion.

    What the paths of repeats differ by changes a response by far less than the engine's error.
    """
    places = [(table, k) for table in tables for k in range(len(table.episodes))]
    episodes = [table.episodes[k] for table, k in places]
    for group in _repeats(episodes):
        first, its = places[group[0]]
        for i in group[1:]:
            table, k = places[i]
            if _compared(episodes[i]) == _compared(episodes[group[0]]):
                table.repeat(k, first, its)


def _compared(episode: Episode) -> tuple[int, int]:
    """Count frames and patches that are compared."""
    return len(compared_frames(len(episode.times))), episode.patches


def _repeats(episodes: Sequence[Episode]) -> list[np.ndarray]:
    durations_s = [float(e.times[-1] - e.times[0]) for e in episodes]
    return repeats_of(path_distances([tool_path(e) for e in episodes], durations_s))


def _with_patches_of(episode: Episode, other: Episode) -> Episode:
    """Group the points of an episode as those of another one that lie nearest at the start, from the object's foot."""
    if len(episode.patch) < other.patches:
        return episode
    places, points = (e.points[0] - foot_of(e) for e in (other, episode))
    patch = other.patch[cKDTree(places).query(points)[1]]
    for empty in np.setdiff1d(np.arange(other.patches), patch):
        counts = np.bincount(patch, minlength=other.patches)
        apart = np.linalg.norm(points - places[other.patch == empty].mean(0), axis=1)
        patch[np.where(counts[patch] > 1, apart, np.inf).argmin()] = empty
    return replace(episode, patch=patch)
