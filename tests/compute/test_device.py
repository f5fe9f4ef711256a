"""Stages compute where their tensors live.

The suite has no CUDA device. What it can tell: with another default device nothing may be made there, since every
tensor must be made where its operands are. ("meta" tensors hold no data, so that mixing them in fails at once.)
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from plop.compute.device import chosen_device
from plop.dynamics.episodes import measured_views
from plop.dynamics.filter.particle_filter import UpdateConfig, settled
from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.interface import at_rest
from plop.dynamics.losses.physical import Neighbourhood
from plop.dynamics.resampling import ResamplingConfig
from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat
from plop.models import device_of
from plop.physics.adapters.augmented import AugmentedModel
from plop.recordings.set import RecordingSet
from plop.render.losses import RenderWeights
from stages.fit_init.optimise import fit
from stages.fit_init.stage import FitInitConfig
from stages.train.objective import TrainingStep
from stages.train.settings import LossWeights
from stages.train.tracks import load_track, track_episode
from stages.train.windows import Window
from tests.support.small_episode import write_set


@pytest.fixture(scope="module")
def episode(tmp_path_factory):
    """One track, the recording's first views and the fitted Gaussians."""
    folder = tmp_path_factory.mktemp("set")
    recordings, init = write_set(folder, train=1, test=0)
    episodes = RecordingSet.load(recordings)
    path, splat = episodes.path("episode_0"), init / "episode_0" / "object.ply"
    track_episode(path, splat, folder / "track.h5", UpdateConfig(iterations=1), lambda done, frames: None)
    with episodes.open("episode_0") as recording:
        views = measured_views(recording, 0)
    return load_track("episode_0", path, folder / "track.h5"), views, read_splat(splat)


@pytest.mark.parametrize("resampling", [ResamplingConfig(), ResamplingConfig(merge_below=0.95, split_above=1.0)])
def test_a_training_step_makes_nothing_elsewhere(episode, resampling):
    track, _, _ = episode
    model = PlopModel(PlopConfig(resampling=resampling, tool_points=50))
    optimiser = torch.optim.AdamW(model.parameters())
    weights = LossWeights(rotation=1.0)
    windows = [Window(0, start, 2, (True, False), seed, (0, 1)) for start, seed in ((0, 1), (2, 2))]
    step_loss = TrainingStep(model)
    with torch.device("meta"):
        loss, _ = step_loss(windows, [track, track], weights, RenderWeights(), 1e-3)
        loss.backward()
        optimiser.step()
    assert loss.device.type == "cpu" and torch.isfinite(loss.detach())


def test_the_filter_makes_nothing_elsewhere(episode):
    _, views, initial = episode
    with torch.device("meta"):
        moved = settled(initial, views, UpdateConfig(iterations=2), 1)
        pairs = Neighbourhood.of(moved.means).following(torch.arange(len(moved), device="cpu"))
    assert moved.means.device.type == pairs.first.device.type == "cpu"


def test_fitting_makes_nothing_elsewhere(episode):
    _, views, initial = episode
    config = FitInitConfig(steps=6, densifications=1, fill_at=0.5)
    with torch.device("meta"):
        shell, inner = fit(
            initial,
            views,
            config,
            spacing_m=0.005,
            max_count=len(initial) + 20,
            fill=lambda g: g.select(torch.arange(7, device="cpu")),
        )
    assert len(shell) > len(initial) and len(inner) == 7
    assert shell.means.device.type == inner.means.device.type == "cpu"


def test_a_model_steps_where_its_weights_are(episode):
    track, _, initial = episode
    model = PlopModel(PlopConfig(tool_points=50, stray_m=0.0, cut_faces=True))
    state = at_rest(initial)
    with torch.device("meta"):
        for k in range(len(track) - 1):
            state = model.step(state, track.actions.step(k))
    assert (state.side != 0).any()
    assert state.gaussians.means.device.type == "cpu"


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_a_gpu_predicts_what_the_cpu_predicts(episode):
    track, _, initial = episode
    torch.manual_seed(0)
    model = PlopModel(PlopConfig(tool_points=50, stray_m=1e-5, cut_faces=True)).eval()
    torch.nn.init.normal_(model.network.decode[-1].weight, std=0.3)
    ends = []
    for device in ("cpu", "cuda"):
        actions = replace(track.actions, world_from_tool=track.actions.world_from_tool.to(device))
        state, moving = at_rest(initial.to(device)), model.to(device)
        with torch.no_grad():
            for k in range(len(track) - 1):
                state = moving.step(state, actions.step(k))
        assert state.gaussians.means.device.type == device
        ends.append(state.gaussians.to("cpu"))
    assert torch.allclose(ends[0].means, ends[1].means, atol=2e-5)
    assert torch.allclose(ends[0].covariances, ends[1].covariances, atol=2e-8)


def test_devices_are_chosen_by_name(monkeypatch):
    assert chosen_device("cpu") == torch.device("cpu")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert chosen_device("auto") == torch.device("cpu")
    with pytest.raises(PlopError, match="no such CUDA device"):
        chosen_device("cuda")
    for name in ("gpu", "cuda:x", "cpu:1:2x"):
        with pytest.raises(PlopError, match="no such device"):
            chosen_device(name)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    assert chosen_device("auto") == torch.device("cuda", 0)
    assert chosen_device("cuda:1") == torch.device("cuda", 1)
    monkeypatch.setenv("LOCAL_RANK", "1")
    assert chosen_device("cuda") == torch.device("cuda", 1)
    with pytest.raises(PlopError, match="no such CUDA device"):
        chosen_device("cuda:2")


def test_effects_leave_a_model_on_its_device():
    model = PlopModel(PlopConfig())
    augmented = object.__new__(AugmentedModel)
    augmented.base = model.to("meta")
    assert device_of(augmented) == torch.device("meta")
    assert device_of(object()) == torch.device("cpu")  # the engine
