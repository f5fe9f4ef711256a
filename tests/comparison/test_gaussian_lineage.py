"""Points that move with Gaussians, through split and merge; covariances that a material carries along."""

from __future__ import annotations

import numpy as np
import torch

from plop.comparison.gaussian_lineage import followed
from plop.gaussians.deformation import carried
from tests.support.coarse_episodes import gaussians

PLACES = np.random.default_rng(0).uniform(-0.03, 0.03, (60, 3))


def turned(points: np.ndarray, angle: float = 0.4) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T


def test_points_on_gaussians_go_where_they_go():
    first = gaussians(PLACES)
    now = first.with_(means=torch.tensor(PLACES + [0.01, 0, 0.002], dtype=torch.float32))
    np.testing.assert_allclose(followed(first, now, PLACES[:9]), PLACES[:9] + [0.01, 0, 0.002], atol=1e-6)


def test_order_split_and_merge_do_not_matter():
    first = gaussians(PLACES)
    shifted = first.with_(means=first.means + torch.tensor([0.0, 0.01, 0.0]))
    rows = torch.cat([torch.arange(59, 9, -1), torch.tensor([20, 20, 20])])  # ten are gone, one is there four times
    found = followed(first, shifted.select(rows), PLACES)
    np.testing.assert_allclose(found, PLACES + [0, 0.01, 0], atol=1e-6)


def test_strangers_are_left_out():
    first = gaussians(PLACES)
    now = first.with_(ids=torch.where(first.ids < 30, first.ids, first.ids + 1000))
    now = now.with_(means=now.means + (now.ids >= 1000)[:, None] * 1.0)
    np.testing.assert_allclose(followed(first, now, PLACES), PLACES, atol=1e-6)


def test_a_rotation_turns_covariances_and_is_given_back():
    first = gaussians(PLACES).with_(scales=torch.tensor([[0.001, 0.002, 0.004]]).repeat(60, 1))
    rotation = turned(np.eye(3)).T
    after, vector = carried(first, turned(PLACES), np.tile(rotation, (60, 1, 1)))
    expected = torch.tensor(rotation, dtype=torch.float32) @ first.covariances @ torch.tensor(rotation.T).float()
    np.testing.assert_allclose(after.covariances, expected, atol=1e-9)
    np.testing.assert_allclose(vector, np.tile([0, 0, 0.4], (60, 1)), atol=1e-5)
    np.testing.assert_allclose(after.means, turned(PLACES), atol=1e-7)


def test_a_stretch_stretches_covariances_and_turns_nothing():
    first = gaussians(PLACES)
    after, vector = carried(first, PLACES, np.tile(np.diag([2.0, 1.0, 0.5]), (60, 1, 1)))
    expected = np.tile(np.diag([0.004, 0.002, 0.001]) ** 2, (60, 1, 1))
    np.testing.assert_allclose(after.covariances, expected, atol=1e-9)
    np.testing.assert_allclose(vector, 0, atol=1e-6)
