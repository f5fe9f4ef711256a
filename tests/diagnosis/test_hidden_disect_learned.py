"""The learned base of the hidden DiSECt sets: motions that are made up, tracks without noise, error with an effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.hidden_disect import _error
from benchmarks.hidden_disect_learned import PUSH_M, PUSH_M_S, TURN_RAD, another_motion, calmed
from plop.diagnosis.responses import Answer
from tests.support.coarse_episodes import coarse_episode, wrapped


@pytest.fixture(scope="module")
def episode():
    return wrapped(coarse_episode(0))


def test_a_made_up_motion_cuts_as_deep_and_pushes_along_the_blade_s_normal(episode):
    generator = np.random.default_rng(1)
    for k in range(20):
        made_up = another_motion(episode, f"made_up_{k}", generator)
        poses, times = made_up.tool.world_from_tool, made_up.times
        assert made_up.points.shape == (len(times), *episode.points.shape[1:]) and (np.diff(times) > 0).all()
        assert poses[0, 2, 3] == pytest.approx(episode.tool.world_from_tool[0, 2, 3])
        assert poses[:, 2, 3].min() == pytest.approx(episode.tool.world_from_tool[:, 2, 3].min())
        np.testing.assert_allclose(poses[:, :3, :3], np.broadcast_to(poses[0, :3, :3], (len(poses), 3, 3)), atol=1e-12)
        push = poses[-1, :3, 3] - poses[20, :3, 3]
        way = np.linalg.norm(push)
        assert PUSH_M[0] <= way <= PUSH_M[1] and push[2] == pytest.approx(0, abs=1e-12)
        assert abs(push @ poses[0, :3, 0]) == pytest.approx(way, rel=1e-6)
        assert abs(np.arctan2(poses[0, 1, 0], poses[0, 0, 0])) <= TURN_RAD
        speed = way / (times[-1] - times[20])
        assert 0.8 * PUSH_M_S[0] < speed < 1.25 * PUSH_M_S[1]  # whole frames


def test_calmed_points_keep_their_motion_and_lose_their_noise(episode):
    exact = episode.points[0] + np.linspace(0, 0.01, len(episode.times))[:, None, None] * np.array([1.0, 0, 0])
    noise = np.random.default_rng(0).normal(0, 3e-4, exact.shape)
    noise[0] = 0
    calm = calmed(replace(episode, points=exact + noise)).points
    assert np.abs(calm - exact).mean() < 0.5 * np.abs(noise).mean()


def test_an_effect_moves_the_learned_prediction_by_what_it_moves_the_engine(episode):
    truth, step = episode.points, np.linspace(0, 1e-3, len(episode.times))[:, None, None] * np.ones(3)
    plain = Answer(truth + 5 * step)
    assert _error(episode, [truth - step], plain, Answer(truth + 6 * step)) == pytest.approx(0, abs=1e-12)
    alone, engine = _error(episode, [truth - step], plain, plain), _error(episode, [plain.points], plain, plain)
    assert engine == pytest.approx(25 * alone)
    assert _error(episode, [truth], plain, Answer(None, "unstable")) == np.inf
