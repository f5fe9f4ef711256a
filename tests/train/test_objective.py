"""The distance to the track counts what a rollout would show."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from plop.dynamics.filter.particle_filter import UpdateConfig
from plop.recordings.set import RecordingSet
from stages.train.objective import SMOOTH_M, _Rollout, _track_error
from stages.train.tracks import Track, load_track, track_episode
from stages.train.windows import Window
from tests.support.small_episode import write_set

FRAME = 3


@pytest.fixture(scope="module")
def track(tmp_path_factory) -> Track:
    folder = tmp_path_factory.mktemp("set")
    recordings, init = write_set(folder, train=1, test=0)
    path = RecordingSet.load(recordings).path("episode_0")
    splat = init / "episode_0" / "object.ply"
    track_episode(path, splat, folder / "track.h5", UpdateConfig(iterations=1), lambda done, frames: None)
    return load_track("episode_0", path, folder / "track.h5")


def error(track: Track, **changes: torch.Tensor) -> float:
    """Of the track's own state, changed."""
    state, count = track.state(FRAME), len(track.initial)
    predicted = replace(state, gaussians=state.gaussians.with_(**changes))
    window = Window(0, 0, FRAME, (False, False), 0, (0,) * FRAME)
    rollout = _Rollout(window, track, state, track.pairs, torch.arange(count), torch.zeros(count, 3))
    return float(_track_error(rollout, predicted, FRAME))


def test_the_track_itself_costs_nothing(track):
    assert error(track) == pytest.approx(4 * SMOOTH_M, rel=1e-3)


def test_a_shift_costs_its_length(track):
    means = track.means[FRAME] + torch.tensor([0.001, 0.0, 0.0])
    assert error(track, means=means) - error(track) == pytest.approx(0.001, rel=0.02)


def test_shrinking_and_fading_cost_as_much_as_what_they_take_away(track):
    scales, opacities = track.initial.scales, track.opacities[FRAME]
    longest = float(scales.norm(dim=-1).mean())
    assert error(track, scales=0.8 * scales) - error(track) == pytest.approx(0.2 * longest, rel=0.05)
    faded = error(track, opacities=opacities - 0.2) - error(track)
    assert faded == pytest.approx(0.2 * longest, rel=0.05)
