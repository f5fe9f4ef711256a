"""Training on episodes that the engine makes up beside the recorded ones."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from plop.dynamics.filter.particle_filter import UpdateConfig
from plop.dynamics.i2n.model import PlopModel
from plop.dynamics.i2n.model_io import save_model
from plop.dynamics.i2n.network import I2NConfig
from plop.errors import PlopError
from plop.gaussians.trajectory import Trajectory
from plop.models import trained_on
from plop.physics.adapters.filled_model import FilledEngineModel
from plop.pipeline.stage import Input, Output
from plop.recordings.set import RecordingSet
from stages.train import simulated_episodes, stage
from stages.train.settings import MadeUpConfig, TrainConfig
from stages.train.simulated_episodes import SimulatedEpisode
from stages.train.stage import run, train_on
from stages.train.training_set import TrainingSet
from tests.support.small_episode import PUSH_M, write_set
from tests.support.tracked_set import write_engine

QUICK = TrainConfig(
    track_steps=3,
    image_steps=2,
    batch=2,
    horizon=1,
    network=I2NConfig(width=4, cells_across=4),
    update=UpdateConfig(iterations=1),
    made_up=MadeUpConfig(reach=3.0, episodes=3),
    jobs=1,
)
NAMES = ["episode_0-0", "episode_1-1", "episode_0-2"]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("set")
    recordings, init = write_set(folder)
    return {"recordings": Input(recordings), "init": Input(init), "engine": write_engine(folder / "engine", "block")}


@pytest.fixture(scope="module")
def trained(inputs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained")
    return folder, run(inputs, QUICK, Output(folder))


def training_set(inputs, folder) -> TrainingSet:
    recordings = RecordingSet.load(inputs["recordings"].path)
    episodes = [SimulatedEpisode(k, f"episode_{k % 2}") for k in range(3)]
    return TrainingSet(recordings, folder, torch.device("cpu"), list(recordings.train), episodes)


def test_the_engine_carries_the_fitted_gaussians_through_other_motions(inputs, trained):
    folder, summary = trained
    assert sorted(p.name for p in (folder / "made-up").iterdir()) == sorted(f"{name}.h5" for name in NAMES)
    assert summary.figures["made_up_episodes"] == 3 and not summary.warnings
    tracks = [training_set(inputs, folder).track(k) for k in range(4, 7)]
    recorded = training_set(inputs, folder).track(0)
    for track in tracks:
        assert track.recording_path is None and track.actions.table_z_m == 0.0
        assert len(track) == len(track.actions)
        assert torch.equal(track.means[0], recorded.means[0])
        assert not torch.equal(track.actions.world_from_tool[0], recorded.actions.world_from_tool[0])
    pushes = [float((t.actions.world_from_tool[-1] - t.actions.world_from_tool[0])[:2, 3].norm()) for t in tracks]
    carried = [float((t.means[-1] - t.means[0])[t.sides[-1] != 0, :2].norm(dim=-1).max()) for t in tracks]
    assert max(pushes) > 1.3 * 3 * PUSH_M
    assert carried[int(np.argmax(pushes))] > 0.3 * max(pushes)


def test_recorded_episodes_weigh_as_much_as_made_up_ones_and_alone_choose_the_weights(inputs, tmp_path, monkeypatch):
    def noted(track, episodes, config, out, *, judged, **more):
        seen.append(([track(i).name for i in range(episodes)], judged))
        return train_on(track, episodes, config, out, judged=judged, **more)

    seen: list[tuple[list[str], int]] = []
    monkeypatch.setattr(stage, "train_on", noted)
    run(inputs, replace(QUICK, folds=2), Output(tmp_path))
    recorded = ["episode_0", "episode_1"]
    assert seen == [
        (["episode_1", "episode_1-1"], 1),
        (["episode_0", "episode_0", "episode_0-0", "episode_0-2"], 1),
        ([*recorded, *recorded, *NAMES], 2),
    ]
    assert trained_on(tmp_path) == {"episode_0", "episode_1"}
    assert json.loads((tmp_path / "model.json").read_text())["training"]["made_up"] == 3


def test_they_change_what_is_learned_and_nothing_when_there_are_none(inputs, trained, tmp_path):
    weights = {}
    for name, config, given in (
        ("none", replace(QUICK, made_up=MadeUpConfig(episodes=0)), inputs),
        ("no engine", QUICK, {k: v for k, v in inputs.items() if k != "engine"}),
    ):
        (tmp_path / name).mkdir()
        run(given, config, Output(tmp_path / name))
        weights[name] = load_file(tmp_path / name / "model.safetensors")
    assert all(torch.equal(value, weights["no engine"][key]) for key, value in weights["none"].items())
    with_them = load_file(trained[0] / "model.safetensors")
    assert any(not torch.equal(value, with_them[key]) for key, value in weights["none"].items())


def test_the_same_seed_makes_up_the_same(inputs, trained, tmp_path):
    run(inputs, QUICK, Output(tmp_path))
    for name in NAMES:
        with (
            Trajectory(trained[0] / "made-up" / f"{name}.h5") as one,
            Trajectory(tmp_path / "made-up" / f"{name}.h5") as two,
        ):
            last = one.frames("updated")[-1]
            assert torch.equal(one.read("updated", last).means, two.read("updated", last).means)


def test_what_the_engine_cannot_follow_is_left_out_and_said(inputs, tmp_path, monkeypatch):
    def failing(model, start, steps, name, seed):
        if name == NAMES[1]:
            raise PlopError("It flew apart.")
        return real(model, start, steps, name, seed)

    real = simulated_episodes.predict
    monkeypatch.setattr(simulated_episodes, "predict", failing)
    summary = run(inputs, QUICK, Output(tmp_path))
    assert summary.figures["made_up_episodes"] == 2
    assert summary.warnings == ["the engine failed in 1 of 3 simulated episodes"]
    assert json.loads((tmp_path / "made-up" / f"{NAMES[1]}.json").read_text()) == {"not_followed": "It flew apart."}
    assert not (tmp_path / "made-up" / f"{NAMES[1]}.h5").exists()


class _Stopped(Exception):
    pass


def test_a_stopped_run_keeps_the_episodes_that_were_made_up(inputs, tmp_path, monkeypatch):
    def progress(done, total, label="", **figures):
        if label.startswith("train"):
            raise _Stopped

    with pytest.raises(_Stopped):
        run(inputs, QUICK, Output(tmp_path, progress))
    monkeypatch.setattr(FilledEngineModel, "step", None)
    assert run(inputs, QUICK, Output(tmp_path)).figures["made_up_episodes"] == 3


def test_a_learned_model_makes_nothing_up(inputs, tmp_path):
    from plop.dynamics.i2n.model import PlopConfig
    from plop.dynamics.i2n.network import I2NConfig

    save_model(tmp_path / "learned", PlopModel(PlopConfig(network=I2NConfig(width=4))), training={})
    (tmp_path / "out").mkdir()
    with pytest.raises(PlopError, match="only be simulated with an engine"):
        run({**inputs, "engine": Input(tmp_path / "learned")}, QUICK, Output(tmp_path / "out"))
    assert not list((tmp_path / "out").iterdir())


def test_an_engine_of_another_object_is_refused(inputs, tmp_path):
    other = write_engine(tmp_path / "engine", "apple")
    (tmp_path / "out").mkdir()
    with pytest.raises(PlopError, match="different objects"):
        run({**inputs, "engine": other}, QUICK, Output(tmp_path / "out"))
    assert not list((tmp_path / "out").iterdir())


def fitted_engine(folder, episodes, recordings=(), effect_episodes=None):
    """An engine whose model.json tells what it was fitted to; with an added effect that was fitted, too."""
    given = write_engine(folder / "base" if effect_episodes else folder, "block")
    facts = json.loads((given.path / "model.json").read_text())
    facts["training"] |= {"episodes": episodes, "recordings": list(recordings)}
    (given.path / "model.json").write_text(json.dumps(facts))
    if not effect_episodes:
        return given
    effect = {"effect": "tilt", "parameters": {"gx_m_s2": {"value": 0.5}}}
    facts |= {"kind": "augmented", "effects": [effect], "fitted": {"episodes": effect_episodes, "recordings": []}}
    (folder / "model.json").write_text(json.dumps(facts))
    return Input(folder)


@pytest.mark.parametrize(
    "more", [{"episodes": ["episode_0", "episode_2"]}, {"episodes": ["episode_0"], "effect_episodes": ["episode_2"]}]
)
def test_an_engine_that_has_seen_test_episodes_is_refused_before_anything_is_tracked(inputs, tmp_path, more):
    (tmp_path / "out").mkdir()
    with pytest.raises(PlopError, match="fitted to test episodes") as caught:
        run({**inputs, "engine": fitted_engine(tmp_path / "engine", **more)}, QUICK, Output(tmp_path / "out"))
    assert caught.value.found == "episode_2" and "plop identify --split train" in caught.value.fix
    assert not list((tmp_path / "out").iterdir())


def test_recordings_are_told_apart_by_content_not_by_the_names_of_their_episodes(inputs, tmp_path):
    from plop.artifacts.lineage import recordings_content
    from plop.artifacts.manifest import Manifest

    ingested = Manifest("ingest", "a" * 16, 1, {}, {}, files={"episodes/episode_0.h5": "1" * 64})
    content = recordings_content(ingested)
    calibrated = Manifest("calibrate", "b" * 16, 1, {}, {"recordings": {"content": content[0]}}, files={"x": "2" * 64})
    own = replace(inputs["recordings"], manifest=calibrated)
    (tmp_path / "out").mkdir()
    with pytest.raises(PlopError, match="fitted to test episodes"):
        run(
            {**inputs, "recordings": own, "engine": fitted_engine(tmp_path / "same", ["episode_2"], content)},
            QUICK,
            Output(tmp_path / "out"),
        )
    other = fitted_engine(tmp_path / "other", ["episode_2"], ["3" * 64])
    assert run({**inputs, "recordings": own, "engine": other}, QUICK, Output(tmp_path / "out")).figures


@pytest.mark.parametrize("setting", [{"episodes": -1}, {"speed": 0.5}, {"turn_deg": 200.0}])
def test_settings_out_of_range_are_refused(setting):
    with pytest.raises(PlopError, match=next(iter(setting))):
        MadeUpConfig(**setting)
