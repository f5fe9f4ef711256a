"""The learned base of the missing-physics benchmark: followed points as particles, rollouts as predictions."""

from __future__ import annotations

import numpy as np
import torch

from benchmarks.physics_learned import facts_of, gaussians_of, predicted, rms_m, track_of
from plop.diagnosis.table import Measured
from plop.dynamics.i2n import I2NConfig
from plop.dynamics.model import PlopConfig, PlopModel
from plop.dynamics.resampling import ResamplingConfig
from plop.pipeline.stage import Output
from stages.train.settings import TrainConfig
from stages.train.stage import train_on
from tests.support.coarse_episodes import coarse_episode, wrapped


def test_an_episode_becomes_a_track():
    episode = wrapped(coarse_episode(0))
    track = track_of(episode)
    assert len(track) == len(episode.times) and len(track.actions) == len(track)
    np.testing.assert_allclose(track.means.numpy(), episode.points, atol=1e-6)
    steps = track.translations[1:].sum(0)
    np.testing.assert_allclose(steps.numpy(), episode.points[-1] - episode.points[0], atol=1e-5)
    assert set(track.sides[0].tolist()) == {0.0} and set(track.sides[-1].tolist()) <= {-1.0, 0.0, 1.0}


def test_predictions_start_where_the_points_are_and_rms_is_a_length():
    episode = wrapped(coarse_episode(0))
    torch.manual_seed(0)
    model = PlopModel(PlopConfig(network=I2NConfig(width=8, cells_across=4)))
    points = predicted(model, episode)
    assert points.shape == episode.points.shape
    np.testing.assert_allclose(points[0], episode.points[0], atol=1e-8)  # the model computes in float32
    assert rms_m(episode, episode.points) == 0
    aside = episode.points + np.linspace(0, 0.003, len(episode.times))[:, None, None] * [1, 0, 0]
    assert 0.001 < rms_m(episode, aside) < 0.003


def test_training_on_points_lowers_the_error(tmp_path):
    track = track_of(wrapped(coarse_episode(0)))
    config = TrainConfig(
        track_steps=60,
        image_steps=0,
        horizon=2,
        network=I2NConfig(width=8, cells_across=5),
        resampling=ResamplingConfig(enabled=False),
        validate_every=10,
        learning_rate=5e-3,
        averaging=0.8,
        device="cpu",
    )
    _, chosen = train_on(lambda k: track, 1, config, Output(tmp_path), about={})
    still = float((track.means[1:] - track.means[:1]).norm(dim=-1).mean()) * 1000
    assert chosen["rollout_error_mm"] < 0.95 * still


def test_gaussians_have_a_line_of_their_own():
    gaussians = gaussians_of(np.zeros((3, 3)))
    assert gaussians.ids.tolist() == [0, 1, 2] and gaussians.quats[:, 0].tolist() == [1, 1, 1]


def test_the_file_tells_how_far_the_base_is_off():
    episode = wrapped(coarse_episode(0))
    facts = facts_of([], Measured([episode], {episode.name: [np.repeat(episode.points[:1], len(episode.times), 0)]}))
    assert facts["base_rms_mm"][0] > 0.5 and facts["runs"] == []
