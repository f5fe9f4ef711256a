"""Repeats of a motion, compared patch by patch: the same places of the object in each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from plop.diagnosis.discrepancy import path_distances
from plop.diagnosis.evidence import evidence_of
from plop.diagnosis.noise import repeats_of
from plop.tracking.episode import Episode


def with_shared_patches(sets: Sequence[Sequence[Episode]]) -> list[list[Episode]]:
    """Give repeats of a motion the patches of the first of them; other episodes keep their own.

    Args:
        sets: Recordings to explain, and the reference.
    """
    episodes = [episode for each in sets for episode in each]
    found = list(episodes)
    for group in repeats_of(path_distances([evidence_of(e, [e.points]) for e in episodes])):
        first = episodes[group[0]]
        for k in group[1:]:
            found[k] = _with_patches_of(episodes[k], first)
    ends = np.cumsum([len(each) for each in sets])
    return [found[end - len(each) : end] for each, end in zip(sets, ends, strict=True)]


def _with_patches_of(episode: Episode, other: Episode) -> Episode:
    """Group the points of an episode as those of another one that lie nearest at the start, from the object's foot."""
    if len(episode.patch) < other.patches:
        return episode
    places, points = _places(other), _places(episode)
    patch = other.patch[cKDTree(places).query(points)[1]]
    for empty in np.setdiff1d(np.arange(other.patches), patch):
        counts = np.bincount(patch, minlength=other.patches)
        apart = np.linalg.norm(points - places[other.patch == empty].mean(0), axis=1)
        patch[np.where(counts[patch] > 1, apart, np.inf).argmin()] = empty
    return replace(episode, patch=patch)


def _places(episode: Episode) -> np.ndarray:
    """Points at the start, from the middle of the object's foot, [M, 3] [m]."""
    foot = np.array([*episode.vertices.mean(0)[:2], episode.vertices[:, 2].min()])
    return np.asarray(episode.points[0] - foot)
