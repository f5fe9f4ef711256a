"""Repeats of a motion, compared patch by patch: the same places of the object in each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from plop.diagnosis.discrepancy import path_distances
from plop.diagnosis.evidence import foot_of, tool_path
from plop.diagnosis.noise import repeats_of
from plop.diagnosis.table import Measured
from plop.tracking.episode import Episode


def with_shared_patches(*sets: Measured) -> list[Measured]:
    """Give repeats of a motion the patches of the first of them; other episodes keep their own."""
    episodes = [episode for each in sets for episode in each.episodes]
    found = list(episodes)
    durations_s = [float(e.times[-1] - e.times[0]) for e in episodes]
    for group in repeats_of(path_distances([tool_path(e) for e in episodes], durations_s)):
        for k in group[1:]:
            found[k] = _with_patches_of(episodes[k], episodes[group[0]])
    ends = np.cumsum([len(each.episodes) for each in sets])
    return [replace(each, episodes=found[end - len(each.episodes) : end]) for each, end in zip(sets, ends, strict=True)]


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
