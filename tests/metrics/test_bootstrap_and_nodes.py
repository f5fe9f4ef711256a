"""The interval over episodes, and the error of material points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import bootstrap

from plop.metrics.node_error import ancestor_means, move_nodes, rms_mm
from plop.statistics.bootstrap import Interval, bootstrap_interval


def test_interval_against_scipy():
    values = np.random.default_rng(0).normal(5, 1, 12)
    found = bootstrap_interval(list(values), draws=20000)
    oracle = bootstrap((values,), np.mean, n_resamples=20000, method="percentile", rng=1).confidence_interval
    assert found.mean == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx((oracle.low, oracle.high), abs=0.03)


def test_two_episodes_give_the_smaller_and_the_larger():
    assert bootstrap_interval([3.0, 1.0]) == Interval(2.0, 1.0, 3.0, 2)


def test_one_episode_has_no_interval_and_none_has_nothing():
    assert bootstrap_interval([4.0, None]) == Interval(4.0, None, None, 1)
    assert bootstrap_interval([None, None]) is None


def test_the_seed_decides():
    values = [1.0, 2.0, 5.0, 9.0, 4.0]
    assert bootstrap_interval(values, seed=1) == bootstrap_interval(values, seed=1)


def test_descendants_stand_for_their_ancestor_by_opacity():
    means = np.array([[0.0, 0, 0], [4.0, 0, 0], [7.0, 7, 7]])
    ids, found = ancestor_means(np.array([5, 5, 2]), means, np.array([0.75, 0.25, 0.1]))
    assert ids.tolist() == [2, 5]
    assert found == pytest.approx(np.array([[7.0, 7, 7], [1.0, 0, 0]]))


def test_nodes_follow_a_rigid_motion_exactly():
    rng = np.random.default_rng(1)
    carriers, nodes = rng.random((200, 3)) * 0.05, rng.random((40, 3)) * 0.05
    turn, shift = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix(), np.array([0.01, 0.02, -0.01])
    found = move_nodes(nodes, carriers, carriers @ turn.T + shift)
    assert np.abs(found - (nodes @ turn.T + shift)).max() < 1e-9


def test_rms_by_hand():
    assert rms_mm(np.zeros((2, 3)), np.array([[0.003, 0, 0], [0, 0.004, 0]])) == pytest.approx(np.sqrt(12.5))
