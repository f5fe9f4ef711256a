"""Repeats of a motion have the same patches, in whatever points each was followed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from plop.diagnosis.repeats import with_shared_patches
from plop.physics.scenes.scene import simulate_episode
from plop.tracking.episode import episode_from_sequence
from tests.support.coarse_episodes import SCENE


def followed(k: int, seed: int, points: int = 150):
    return episode_from_sequence(simulate_episode(SCENE, k), noise_m=1e-4, seed=seed, points=points)


def middles(episode):
    counts = np.bincount(episode.patch, minlength=episode.patches)
    assert (counts > 0).all()
    return np.stack([np.bincount(episode.patch, v, episode.patches) for v in episode.points[0].T], 1) / counts[:, None]


def test_repeats_get_the_patches_of_the_first_and_others_keep_their_own():
    first, again, other = followed(0, 1), followed(0, 2, points=170), followed(1, 3)
    (found, unlike), (repeat,) = with_shared_patches([[first, other], [again]])
    assert found is first and unlike is other
    assert repeat.patches == first.patches != again.patches and len(repeat.patch) == 170
    nearest = cKDTree(middles(again)).query(middles(first))[0].mean()
    assert np.linalg.norm(middles(repeat) - middles(first), axis=1).mean() < 0.8 * nearest < 0.01


def test_an_episode_with_fewer_points_than_patches_keeps_its_own():
    first, few = followed(0, 1), followed(0, 2, points=30)
    many = replace(first, patch=np.arange(150))
    assert with_shared_patches([[many], [few]])[1][0] is few


@pytest.mark.parametrize("k", [0, 1])
def test_an_episode_is_its_own_repeat(k):
    (same,), (repeat,) = with_shared_patches([[followed(k, 1)], [followed(k, 1)]])
    np.testing.assert_array_equal(same.patch, repeat.patch)
