"""calibrate on a scene with a closed form: it tells right from wrong cameras, corrects them, and passes on."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.rigid import pose_from_euler_xyz
from plop.pipeline.stage import Input, Output
from plop.recordings.set import RecordingSet
from stages.calibrate.stage import STAGE, CalibrateConfig
from tests.support.ellipsoid_scene import ring, write_set


def calibrate(folder: Path, out: Path, config: CalibrateConfig | None = None):
    out.mkdir(exist_ok=True)
    summary = STAGE.run({"recordings": Input(folder)}, config or CalibrateConfig(), Output(out))
    return summary, json.loads((out / "calibration.json").read_text())


def moved(camera, millimetres, milliradians=(0, 0, 0)):
    """Claim that a camera stands elsewhere: moved, and turned about its own centre."""
    pose = camera.world_from_cam.copy()
    turn = pose_from_euler_xyz(np.array([0, 0, 0, *milliradians]) / 1e3)[:3, :3]
    pose[:3, :3] = turn @ pose[:3, :3]
    pose[:3, 3] += np.array(millimetres) / 1e3
    return replace(camera, world_from_cam=pose)


def test_right_cameras_are_good_and_the_file_is_linked(tmp_path):
    write_set(tmp_path / "set", {"a": {}, "b": {}}, cameras=ring())
    summary, facts = calibrate(tmp_path / "set", tmp_path / "out")
    assert summary.figures["cameras_good"] == 6 and summary.figures["worst_disagreement_mm"] < 0.5
    assert {entry["verdict"] for entry in facts["cameras"].values()} == {"good"}
    out = RecordingSet.load(tmp_path / "out")
    assert out.names == ["a", "b"]
    assert out.path("a").stat().st_ino == (tmp_path / "set" / "episodes" / "a.h5").stat().st_ino
    assert sorted(p.name for p in (tmp_path / "out" / "episodes").iterdir()) == ["a.h5", "b.h5"]


def test_a_tool_that_hides_the_object_from_one_of_two_opposed_cameras_is_no_disagreement(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(2), plate=True)
    summary, facts = calibrate(tmp_path / "set", tmp_path / "out")
    assert summary.figures["worst_disagreement_mm"] < 0.5
    assert {entry["verdict"] for entry in facts["cameras"].values()} == {"good"}


def test_a_wrong_camera_is_named_and_corrected(tmp_path):
    cameras = ring()
    wrong = [moved(c, (6, -5, 4), (8, 5, -6)) if c.name == "cam2" else c for c in cameras]
    write_set(tmp_path / "set", {"a": {}}, cameras=wrong, truth=cameras)
    _, reported = calibrate(tmp_path / "set", tmp_path / "seen", CalibrateConfig(correct=False))
    verdicts = {name: entry["verdict"] for name, entry in reported["cameras"].items()}
    assert verdicts == {**dict.fromkeys(verdicts, "good"), "cam2": "bad"}
    assert "cam2" in str(reported["cameras"]["cam2"]) and reported["cameras"]["cam2"]["fix"]
    before = (tmp_path / "set" / "episodes" / "a.h5").read_bytes()
    _, facts = calibrate(tmp_path / "set", tmp_path / "out")
    entry = facts["cameras"]["cam2"]
    assert entry["verdict"] == "corrected" and entry["disagreement_mm"] < 0.5 < 2 < entry["disagreement_before_mm"]
    assert facts["cameras"]["cam0"]["verdict"] == "good"
    assert (tmp_path / "set" / "episodes" / "a.h5").read_bytes() == before
    with RecordingSet.load(tmp_path / "out").open("a") as recording:
        error = recording.camera("cam2", 0).world_from_cam @ np.linalg.inv(cameras[2].world_from_cam)
        assert np.linalg.norm(error[:3, :3] - np.eye(3)) < 5e-3
        at_object = cameras[2].back_project(*_object(recording))
        assert np.linalg.norm((error @ np.r_[at_object.mean(0), 1])[:3] - at_object.mean(0)) < 1e-3


def noisy(noise_m):
    """Depth of a real sensor: noise, and outlines frayed by a pixel."""

    def change(file):
        rng = np.random.default_rng(0)
        for name in file["cameras"]:
            depth = file[f"cameras/{name}/depth_m"]
            rolled = np.roll(depth[:], 1, axis=2)
            frayed = (np.abs(rolled - depth[:]) > 0.02) & (rng.random(depth.shape) < 0.5)
            new = np.where(frayed, rolled, depth[:])
            depth[...] = np.where(new > 0, new + rng.normal(scale=noise_m, size=new.shape), 0)

    return change


@pytest.mark.parametrize("size", [64, 96, 160])
@pytest.mark.parametrize("noise_m", [0.002, 0.004])
def test_noise_does_not_make_a_camera_bad_and_hides_no_wrong_one(tmp_path, size, noise_m):
    cameras = ring(3, size=size)
    wrong = [cameras[0], moved(cameras[1], (14, -12, 9), (12, 9, -10)), cameras[2]]
    for name, claimed in (("right", cameras), ("wrong", wrong)):
        write_set(tmp_path / name, {"a": {}}, cameras=claimed, truth=cameras)
        damage(tmp_path / name, noisy(noise_m))
    _, facts = calibrate(tmp_path / "right", tmp_path / "out")
    assert {entry["verdict"] for entry in facts["cameras"].values()} == {"good"}
    _, facts = calibrate(tmp_path / "wrong", tmp_path / "seen", CalibrateConfig(correct=False))
    assert [facts["cameras"][f"cam{i}"]["verdict"] for i in range(3)] == ["good", "bad", "good"]


def _object(recording):
    view = recording.view("cam2", 0)
    return view.depth_m, view.object_mask


def test_a_wrong_depth_scale_is_found(tmp_path):
    write_set(tmp_path / "set", {"a": {"depth_factor": {"cam1": 1.03}}}, cameras=ring())
    _, facts = calibrate(tmp_path / "set", tmp_path / "out")
    entry = facts["cameras"]["cam1"]
    assert entry["verdict"] == "corrected" and "scale" in entry["fix"]
    assert entry["depth_scale"] == pytest.approx(1 / 1.03, abs=1e-3)
    with RecordingSet.load(tmp_path / "set").open("a") as old, RecordingSet.load(tmp_path / "out").open("a") as new:
        ratio = new.view("cam1", 0).depth_m[48, 48] / old.view("cam1", 0).depth_m[48, 48]
        assert ratio == pytest.approx(1 / 1.03, abs=1e-3)


def damage(folder: Path, change, episode: str = "a") -> None:
    with h5py.File(folder / "episodes" / f"{episode}.h5", "r+") as file:
        change(file)


def test_a_blind_camera_is_bad_and_says_so(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(4))
    damage(tmp_path / "set", lambda file: file["cameras/cam3/depth_m"].__setitem__(..., np.nan))
    summary, facts = calibrate(tmp_path / "set", tmp_path / "out")
    assert facts["cameras"]["cam3"]["verdict"] == "bad" and "sees nothing" in facts["cameras"]["cam3"]["fix"]
    assert facts["cameras"]["cam0"]["verdict"] == "good"
    assert any("cam3" in warning for warning in summary.warnings)


def test_masks_that_are_empty_later_still_compare_the_whole_image(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(4))
    damage(tmp_path / "set", lambda file: [file[f"cameras/cam{i}/mask"].__setitem__(1, 0) for i in range(4)])
    _, facts = calibrate(tmp_path / "set", tmp_path / "out")
    assert {entry["verdict"] for entry in facts["cameras"].values()} == {"good"}


def replaced(key, value):
    """Write another array under a key, of any shape."""

    def change(file):
        del file[key]
        file[key] = value

    return change


def in_every_camera(part, value):
    return lambda file: [file[f"cameras/{name}/{part}"].__setitem__(..., value) for name in file["cameras"]]


def tool_times(factor):
    """Scale the 3x3 part of the tool's poses."""

    def change(file):
        poses = file["tool/world_from_tool"]
        poses[:, :3, :3] = poses[:, :3, :3] * np.array(factor)

    return change


def tool_in_millimetres(file):
    file["tool/world_from_tool"][:, :3, 3] = file["tool/world_from_tool"][:, :3, 3] * 1000


@pytest.mark.parametrize(
    ("change", "key", "message"),
    [
        (tool_times(np.nan), "/tool/world_from_tool", "not finite"),
        (tool_times(2), "/tool/world_from_tool", "not a rotation"),
        (tool_times(0), "/tool/world_from_tool", "not a rotation"),
        (tool_times([-1, 1, 1]), "/tool/world_from_tool", "mirrored"),
        (tool_in_millimetres, "/tool/world_from_tool", "millimetres"),
        (replaced("tool/mesh/vertices", np.zeros((0, 3))), "/tool/mesh", "0 vertices, 4 faces"),
        (replaced("tool/mesh/faces", np.zeros((0, 3), int)), "/tool/mesh", "4 vertices, 0 faces"),
        (replaced("frames/time_s", [0.1, 0.0]), "/frames/time_s", "0 s at frame 1 after 0.1 s"),
        (replaced("frames/time_s", [0.0, np.inf]), "/frames/time_s", "strictly increasing"),
        (in_every_camera("depth_m", np.nan), "/depth_m", "No camera measured any depth"),
        (in_every_camera("depth_m", 0), "/depth_m", "No camera measured any depth"),
        (in_every_camera("mask", 0), "/mask", "No camera sees the object"),
        (replaced("cameras/cam1/mask", np.zeros((2, 48, 96), np.uint8)), "/cameras/cam1/mask", "2 x 48 x 96"),
        (replaced("cameras/cam1/depth_m", np.zeros((2, 96, 95))), "/cameras/cam1/depth_m", "2 x 96 x 96"),
    ],
)
def test_what_no_stage_could_use_is_skipped_by_key(tmp_path, change, key, message):
    write_set(tmp_path / "set", {"a": {}, "b": {}}, cameras=ring(3))
    damage(tmp_path / "set", change)
    summary, facts = calibrate(tmp_path / "set", tmp_path / "out")
    assert list(facts["episodes"]) == ["b"] and RecordingSet.load(tmp_path / "out").names == ["b"]
    assert message in facts["skipped"]["a"] and key in facts["skipped"]["a"].split("expected")[0]
    assert "a.h5:/" in facts["skipped"]["a"]
    damage(tmp_path / "set", change, "b")
    with pytest.raises(PlopError, match="No episode could be calibrated"):
        calibrate(tmp_path / "set", tmp_path / "none")


def test_a_tool_that_only_never_touches_is_no_reason_to_skip(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(3))
    damage(tmp_path / "set", lambda file: file["tool/world_from_tool"].__setitem__((slice(None), 2, 3), 1.5))
    assert calibrate(tmp_path / "set", tmp_path / "out")[0].figures["skipped"] == 0


def test_a_single_camera_is_unchecked_not_good(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(1))
    _, facts = calibrate(tmp_path / "set", tmp_path / "out")
    assert facts["cameras"]["cam0"]["verdict"] == "unchecked"


def scaled(key, factor):
    return lambda file: file[key].__setitem__(..., file[key][:] * factor)


def far(file):
    poses = file["cameras/cam1/world_from_cam"]
    poses[:, :3, 3] = poses[:, :3, 3] * 1000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (scaled("cameras/cam1/depth_m", 1000), "millimetres"),
        (far, "implausibly far away"),
        (scaled("cameras/cam1/intrinsics", -1), "focal length"),
        (scaled("cameras/cam1/world_from_cam", np.nan), "not finite"),
        (scaled("cameras/cam1/world_from_cam", 0.5), "not a rotation"),
        (lambda file: file["tool"].pop("world_from_tool"), "incomplete"),
        (
            lambda file: file["frames"].pop("time_s") and file["frames"].create_dataset("time_s", data=np.arange(9.0)),
            "lengths do not match",
        ),
    ],
)
def test_bad_input_is_explained_and_the_rest_goes_on(tmp_path, change, message):
    write_set(tmp_path / "set", {"a": {}, "b": {}}, cameras=ring(3))

    def pop(file):
        change(file)

    if "incomplete" in message or "lengths" in message:
        damage(tmp_path / "set", _structure(message))
    else:
        damage(tmp_path / "set", pop)
    summary, facts = calibrate(tmp_path / "set", tmp_path / "out")
    assert list(facts["episodes"]) == ["b"] and message in facts["skipped"]["a"]
    assert any(message in warning for warning in summary.warnings)
    assert RecordingSet.load(tmp_path / "out").names == ["b"]


def _structure(message):
    def drop(file):
        if "incomplete" in message:
            del file["tool/world_from_tool"]
        else:
            del file["frames/time_s"]
            file["frames/time_s"] = np.arange(9.0)

    return drop


def test_nothing_usable_is_an_error(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(2))
    damage(tmp_path / "set", scaled("cameras/cam0/depth_m", 1000))
    with pytest.raises(PlopError, match="No episode could be calibrated"):
        calibrate(tmp_path / "set", tmp_path / "out")
