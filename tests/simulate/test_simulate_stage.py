"""simulate as a stage and as a command: recordings like any others, a sealed answer, faults, DROID, resuming."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.physics.scenes.sealed import ANSWER, open_answer
from plop.pipeline.settings import resolve
from plop.pipeline.stage import Input, Output, Summary
from plop.recordings.readers.droid.episode import RowChoice
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet
from plop.recordings.truth import Truth
from plop.render.virtual_cameras.settings import CameraSettings
from plop_cli.app import main
from stages.ingest.droid import INGEST_DROID, DroidConfig
from stages.simulate import stage
from stages.simulate.stage import STAGE, SimulateConfig, read_scene

SCENE = """
name = "gel"
episodes = 4
motions = ["hold", "push"]
frame_rate_hz = 20
spacing_m = 0.0125
[shape]
kind = "block"
size_m = [0.08, 0.05, 0.04]
[motion]
hold_s = [0.1, 0.1]
"""
SMALL = SimulateConfig(cameras=CameraSettings(size=24, count=2, supersample=1, depth_noise_m=0.001))


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "gel.toml"
    path.write_text(SCENE)
    return path


def filmed(config: SimulateConfig, **cameras) -> SimulateConfig:
    return replace(config, cameras=replace(config.cameras, **cameras))


def simulate(scene: Path, folder: Path, config: SimulateConfig = SMALL) -> Summary:
    folder.mkdir(exist_ok=True)
    return STAGE.run({"scene": Input(scene)}, config, Output(folder))


def payload(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not {".done", ".checkpoints"} & set(path.parts)
    }


@pytest.fixture(scope="module")
def plain(scene, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("plain")
    simulate(scene, folder)
    return folder


def test_the_recordings_are_split_by_episode_and_the_answer_says_nothing_hidden(plain):
    recordings = RecordingSet.load(plain)
    assert (recordings.environment, recordings.test) == ("gel", ["gel_003"]) and len(recordings.train) == 3
    with recordings.open("gel_000") as recording, Truth(recordings.path("gel_000")) as truth:
        assert recording.camera_names == ["cam_00", "cam_01"]
        assert truth.surface(0).vertices[:, 2].max() == pytest.approx(0.0395, abs=5e-4)
    assert open_answer(plain)["effects"] == {} and open_answer(plain)["rms_m"] == 0


def test_a_drawn_effect_is_found_in_the_answer_only(scene, plain, tmp_path):
    summary = simulate(
        scene, tmp_path, replace(filmed(SMALL, depth_noise_m=0.0005), hide=("random",), seed=0, episodes=2)
    )
    answer = open_answer(tmp_path)
    ((name, values),) = answer["effects"].items()
    assert answer["random"] and answer["snr"] == pytest.approx(answer["rms_m"] / 0.0005)
    assert 0.2 < answer["snr"] < 6, "sought on a coarser grid, in its right order of size on this one"
    told = json.dumps([summary.figures, summary.table, summary.warnings]) + (tmp_path / "episodes.json").read_text()
    for word in (name, *values):
        assert word not in told
    with Truth(tmp_path / "episodes/gel_000.h5") as told_truth, Truth(plain / "episodes/gel_000.h5") as without:
        assert told_truth.facts == without.facts
        assert np.abs(told_truth.surface(-1).vertices - without.surface(-1).vertices).max() > 1e-4
    assert name.encode() not in (tmp_path / ANSWER).read_bytes()


def test_a_killed_run_goes_on_to_the_same_result(scene, tmp_path, monkeypatch):
    config = replace(SMALL, hide=("tilt=1", "viscosity=5"), episodes=2, jobs=1)
    simulate(scene, tmp_path / "whole", config)
    record = stage.record

    def killed(path, *arguments, **options):
        if path.stem == "gel_001":
            raise KeyboardInterrupt
        return record(path, *arguments, **options)

    monkeypatch.setattr(stage, "record", killed)
    with pytest.raises(KeyboardInterrupt):
        simulate(scene, tmp_path / "killed", config)
    first = (tmp_path / "killed/episodes/gel_000.h5").stat().st_mtime_ns
    assert not (tmp_path / "killed/episodes.json").exists() and not (tmp_path / "killed" / ANSWER).exists()
    monkeypatch.setattr(stage, "record", record)
    simulate(scene, tmp_path / "killed", config)
    assert (tmp_path / "killed/episodes/gel_000.h5").stat().st_mtime_ns == first
    assert payload(tmp_path / "killed") == payload(tmp_path / "whole")


def test_a_fault_changes_its_camera_only(scene, plain, tmp_path):
    quiet = replace(filmed(SMALL, depth_noise_m=0.0), episodes=1)
    simulate(scene, tmp_path / "right", quiet)
    simulate(scene, tmp_path / "wrong", replace(quiet, fault=("depth_scale=1.05@cam_01",)))
    with (
        Recording(tmp_path / "right/episodes/gel_000.h5") as right,
        Recording(tmp_path / "wrong/episodes/gel_000.h5") as wrong,
    ):
        same, scaled = ([r.view(c, 0).depth_m for r in (right, wrong)] for c in ("cam_00", "cam_01"))
        np.testing.assert_array_equal(*same)
        np.testing.assert_allclose(scaled[1], 1.05 * scaled[0], rtol=1e-5)
    assert open_answer(tmp_path / "wrong")["faults"] == {"cam_01": {"depth_scale": {"factor": 1.05}}}


def test_droid_episodes_are_read_back_with_the_object_where_it_was(scene, tmp_path):
    config = replace(filmed(SMALL, size=64, depth_noise_m=0.0), episodes=1, droid=True, colour_noise=0.0)
    simulate(scene, tmp_path / "out", config)
    (tmp_path / "read").mkdir()
    summary = INGEST_DROID.run(
        {"raw": Input(tmp_path / "out/droid")}, DroidConfig(rows=RowChoice(min_frames=3)), Output(tmp_path / "read")
    )
    (name,) = RecordingSet.load(tmp_path / "read").names
    assert summary.figures["skipped"] == 0
    with (
        Recording(tmp_path / f"read/episodes/{name}.h5") as recording,
        Truth(tmp_path / "out/episodes/gel_000.h5") as truth,
    ):
        low, high = (getattr(truth.surface(0).vertices, end)(0) + [0.5, 0, 0] for end in ("min", "max"))
        view = recording.view(recording.camera_names[0], 0)
        points = view.camera.back_project(view.depth_m, view.object_mask)
        assert len(points) > 50 and (points > low - 0.003).all() and (points < high + 0.003).all()
        assert recording.world_from_tool[0, 2, 3] == pytest.approx(0.044, abs=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hide": ("viscocity=4",)}, "Did you mean viscosity"),
        ({"fault": ("clok=0.02",)}, "Did you mean clock"),
        ({"fault": ("clock=0.02@cam_07",)}, "does not exist"),
        ({"test": ("gel_99",)}, "no episode of this name"),
        ({"motions": ("pusk",)}, "Did you mean push"),
        ({"snr": -1.0}, r"simulate\.snr[\s\S]*0 to 1e6"),
        ({"cameras.size": 2}, r"simulate\.cameras\.size[\s\S]*8 to 8192 px"),
        ({"cameras.depth_noise_m": 5.0}, r"depth_noise_m[\s\S]*0 to 0.1 m"),
        ({"cameras.supersample": 2}, "odd"),
        ({"hide": ("viscosity=1",), "snr": 1e5}, "cannot give the requested signal"),
    ],
)
def test_bad_settings_are_refused_and_leave_no_recording(scene, tmp_path, change, message):
    with pytest.raises(PlopError, match=message):
        simulate(scene, tmp_path, resolve(SimulateConfig, "simulate", ("test", {"episodes": 1, **change})))
    assert payload(tmp_path) == {}


def test_motions_are_the_scenes_or_those_asked_for(scene):
    asked = read_scene(scene, replace(SMALL, motions=("push",)))
    assert read_scene(scene, SMALL).motions == ("hold", "push") and asked.motions == ("push",)
    assert {asked.motion_plan(k).kind for k in range(asked.episodes)} == {"push"}


def test_the_command_takes_shipped_scenes_and_repeated_options(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command = ["simulate", "block.toml", "--hide", "viscosity=40", "--hide", "tilt=1,drag=3", "--dry-run", "--json"]
    assert main(command) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["config"]["hide"] == ["viscosity=40", "tilt=1", "drag=3"] and told["would_run"]
    assert main(["simulate", "blok.toml"]) == 1
    assert "Did you mean block.toml" in capsys.readouterr().err


def test_the_command_makes_an_artifact_that_other_stages_take(scene, tmp_path, capsys):
    common = ["-w", str(tmp_path), "-q"]
    small = ["--cameras.size", "24", "--cameras.count", "2", "--cameras.supersample", "1", "--episodes", "2"]
    assert main(["simulate", str(scene), "--hide", "viscosity=5", *small, "--name", "mystery", *common]) == 0
    assert Store(tmp_path).find("mystery").manifest.environment == "gel"
    assert main(["calibrate", "--recordings", "mystery", *common]) == 0, capsys.readouterr().err
    assert main(["fuse", "--dry-run", "--json", *common]) == 0
