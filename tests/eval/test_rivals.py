"""The cheap rivals: what each predicts is known in a scene whose halves part at constant speed."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

import stages.rollout.stage as rollout
from plop.artifacts.layouts import Model
from plop.dynamics.baselines import ConstantVelocity
from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat
from plop.gaussians.trajectory import TrajectoryWriter
from plop.pipeline.stage import Input, Output
from plop.recordings.set import RecordingSet
from stages.eval import rivals
from stages.eval.rivals import Rivals, _tools_apart_m
from stages.eval.stage import STAGE, EvalConfig
from tests.support.block_scene import STEP_M, make_inputs, parted, tool_poses

FRAMES = 4


@pytest.fixture
def scene(tmp_path):
    """Two equal episodes, one for training with its true track; a rollout in which nothing moves."""
    inputs = make_inputs(tmp_path, names=("a", "b"), frames=FRAMES)
    RecordingSet(tmp_path / "recordings", "block", ["a"], ["b"]).save()
    start = read_splat(tmp_path / "init" / "a" / "object.ply")
    track = Model(tmp_path / "trained").tracks.states("a")
    track.parent.mkdir(parents=True)
    with TrajectoryWriter(track) as writer:
        for frame in range(FRAMES):
            writer.append("updated", frame, parted(start, frame))
    (tmp_path / "trained" / "model.json").write_text(json.dumps({"schema": 1, "kind": "plop", "training": {}}))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "load_model", lambda path, device: ConstantVelocity(keep=0))
        (tmp_path / "rollout").mkdir()
        rollout.run(inputs, rollout.RolloutConfig(jobs=1), Output(tmp_path / "rollout"))
    return inputs | {"rollouts": Input(tmp_path / "rollout"), "tracks": Input(tmp_path / "trained")}


def test_replay_and_velocity_are_right_where_motion_repeats_and_goes_on(scene, tmp_path):
    (tmp_path / "out").mkdir()
    STAGE.run(scene, EvalConfig(method="still", observed_frames=1, emd_every=0), Output(tmp_path / "out"))
    report = json.loads((tmp_path / "out" / "scores.json").read_text())
    nodes = {name: method["end"]["truth_rms_mm"]["mean"] for name, method in report["methods"].items()}
    assert set(nodes) == {"still", "persistence", "rigid", "replay", "velocity"}
    assert nodes["still"] == pytest.approx(nodes["persistence"]) == pytest.approx(3000 * STEP_M, rel=1e-3)
    assert nodes["replay"] < 0.02
    assert nodes["velocity"] < 0.8 * nodes["persistence"]  # the filter follows a step of 4 mm only in part
    assert "observed" in report["baselines"]["velocity"] and "engine" not in report["baselines"]


def test_the_residual_is_that_of_the_last_observed_frame(scene, monkeypatch):
    monkeypatch.setattr(rivals, "load_model", lambda folder: ConstantVelocity(keep=0))
    recordings = RecordingSet.load(scene["recordings"].path)
    start = read_splat(scene["init"].path / "b" / "object.ply")
    with recordings.open("b") as recording:
        found = Rivals(recordings, scene["tracks"].path, None, 2).roll_out(recording, start)
    assert {len(frames) for frames in found.values()} == {FRAMES}
    assert torch.equal(found["engine"][-1].means, start.means)
    # The engine stands still: its last residual is the motion so far, and is held.
    torch.testing.assert_close(found["residual"][3].means, found["residual"][2].means, rtol=0, atol=1e-8)  # rounding
    assert torch.equal(found["residual"][1].means, found["velocity"][1].means)
    way = found["velocity"][3].means - found["velocity"][2].means
    torch.testing.assert_close(way, found["velocity"][2].means - found["velocity"][1].means, rtol=1e-3, atol=1e-6)


def test_the_tool_motion_that_is_most_alike_is_found():
    vertices, poses = np.random.default_rng(0).random((9, 3)) * 0.05, tool_poses(FRAMES)
    aside = poses.copy()
    aside[:, 0, 3] += 0.01
    still = np.zeros(3)
    assert _tools_apart_m(vertices, poses, poses, still) == 0
    assert _tools_apart_m(vertices, aside, poses, still) == pytest.approx(0.01)
    assert _tools_apart_m(vertices, aside, poses, np.array([0.01, 0, 0])) == pytest.approx(0)
    assert _tools_apart_m(vertices, poses, poses[:2], still) < 0.01  # it rests where it ends


def test_rivals_of_another_kind_are_refused(scene, tmp_path):
    (tmp_path / "out").mkdir()
    with pytest.raises(PlopError, match="not an engine"):
        STAGE.run(scene | {"engine": scene["tracks"]}, EvalConfig(), Output(tmp_path / "out"))
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "model.json").write_text(json.dumps({"schema": 1, "kind": "plop", "training": {}}))
    with pytest.raises(PlopError, match="no training motion to replay"):
        STAGE.run(scene | {"tracks": Input(tmp_path / "empty")}, EvalConfig(), Output(tmp_path / "out"))
