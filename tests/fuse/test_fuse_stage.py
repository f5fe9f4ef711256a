"""fuse on a scene with a closed form, and on bad input."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.clouds.cloud_ply import read_cloud
from plop.geometry.rigid import pose_from_euler_xyz
from plop.pipeline.stage import Input, Output
from stages.fuse.stage import STAGE, FuseConfig
from tests.support.ellipsoid_scene import CENTER, ellipsoid_distance, ring, write_set


def fuse(folder: Path, out: Path, config: FuseConfig | None = None):
    out.mkdir(exist_ok=True)
    return STAGE.run({"recordings": Input(folder)}, config or FuseConfig(), Output(out))


def test_first_frame_gives_the_surface_with_normals(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring())
    summary = fuse(tmp_path / "set", tmp_path / "out")
    cloud = read_cloud(tmp_path / "out" / "clouds" / "a.ply")
    assert summary.figures["episodes"] == 1 and summary.figures["disagreement_mm"] < 0.5
    assert len(cloud) > 1000
    distance = np.abs(ellipsoid_distance(cloud.points))
    assert np.median(distance) < 2e-4 and np.percentile(distance, 99) < 1.5e-3
    outward = (cloud.points - CENTER) / np.array([0.06, 0.04, 0.03]) ** 2
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    assert np.median((cloud.normals * outward).sum(1)) > 0.99
    assert (tmp_path / "out" / "fuse.json").is_file() and not list((tmp_path / "out" / "clouds").glob("*.part"))


def test_the_same_bytes_twice_and_resume(tmp_path):
    write_set(tmp_path / "set", {"a": {}, "b": {}}, cameras=ring())
    fuse(tmp_path / "set", tmp_path / "one")
    fuse(tmp_path / "set", tmp_path / "two")
    for name in ("clouds/a.ply", "clouds/b.ply", "fuse.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_disagreeing_views_are_registered(tmp_path):
    cameras = ring(8)
    wrong = [
        replace(
            c,
            world_from_cam=pose_from_euler_xyz(
                np.array([0.004 * (i % 3 - 1), 0.004 * (i % 2), 0.003, 0, 0.01 * (i % 2), 0])
            )
            @ c.world_from_cam,
        )
        for i, c in enumerate(cameras)
    ]
    write_set(tmp_path / "set", {"a": {}}, cameras=wrong, truth=cameras)
    fuse(tmp_path / "set", tmp_path / "out")
    facts = json.loads((tmp_path / "out" / "fuse.json").read_text())["episodes"]["a"]
    assert facts["registered"] and facts["disagreement_mm"] > 1.5
    fuse(tmp_path / "set", tmp_path / "raw", FuseConfig(icp_above_mm=1e9))
    registered = read_cloud(tmp_path / "out" / "clouds" / "a.ply").points
    unregistered = read_cloud(tmp_path / "raw" / "clouds" / "a.ply").points
    assert thickness(registered) < 0.5 * thickness(unregistered)


def test_a_tool_that_hides_the_object_from_one_of_two_opposed_cameras_is_no_disagreement(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(2), plate=True)
    fuse(tmp_path / "set", tmp_path / "out")
    facts = json.loads((tmp_path / "out" / "fuse.json").read_text())["episodes"]["a"]
    assert facts["disagreement_mm"] < 0.5 and not facts["registered"] and not facts["warnings"]


def test_a_registration_without_a_finite_answer_is_not_kept(tmp_path, monkeypatch):
    """Normals turned away from each other leave no pair: what nothing was compared with has not been improved."""
    cameras = ring(4)
    wrong = [
        replace(c, world_from_cam=pose_from_euler_xyz(np.array([0.006 * i, 0, 0, 0, 0, 0])) @ c.world_from_cam)
        for i, c in enumerate(cameras)
    ]
    write_set(tmp_path / "set", {"a": {}}, cameras=wrong, truth=cameras)
    monkeypatch.setattr("plop.geometry.clouds.registration._NORMALS_AGREE", 2.0)
    summary = fuse(tmp_path / "set", tmp_path / "out")
    facts = json.loads((tmp_path / "out" / "fuse.json").read_text())["episodes"]["a"]
    assert not facts["registered"]
    assert "registration did not help (no part" in summary.warnings[0] and "nan" not in " ".join(summary.warnings)


@pytest.mark.parametrize(
    "broken", [{"corrections": np.nan}, {"residual_after_mm": np.nan}, {"residual_after_mm": np.inf}]
)
def test_a_registration_that_is_no_number_is_not_kept(tmp_path, monkeypatch, broken):
    import stages.fuse.episode as episode

    cameras = ring(4)
    wrong = [
        replace(c, world_from_cam=pose_from_euler_xyz(np.array([0.006 * i, 0, 0, 0, 0, 0])) @ c.world_from_cam)
        for i, c in enumerate(cameras)
    ]
    write_set(tmp_path / "set", {"a": {}}, cameras=wrong, truth=cameras)

    def register(clouds, **settings):
        found = real(clouds, **settings)
        return replace(found, **{key: getattr(found, key) * value for key, value in broken.items()})

    real = episode.register
    monkeypatch.setattr(episode, "register", register)
    summary = fuse(tmp_path / "set", tmp_path / "out")
    assert summary.table[0]["registered"] is False
    assert "no finite solution" in summary.warnings[0]


VERDICTS = [
    {"camera": "c0", "verdict": "bad", "fix": "its depth disagrees by 11.6 mm"},
    {"camera": "c1", "verdict": "bad", "fix": "its depth disagrees by 9 mm"},
]


@pytest.mark.parametrize("verdict, told", [("bad", True), ("good", False), ("corrected", False)])
def test_that_every_camera_is_bad_is_said_first(tmp_path, verdict, told):
    folder = tmp_path / "set"
    write_set(folder, {"a": {}}, cameras=ring(4))
    facts = {"episodes": {"a": {"cameras": [VERDICTS[0], VERDICTS[1] | {"verdict": verdict}]}}}
    (folder / "calibration.json").write_text(json.dumps(facts))
    warnings = fuse(folder, tmp_path / "out").warnings
    assert told == bool(
        warnings and "calls all 2 of its cameras bad (c0: its depth disagrees by 11.6 mm)" in warnings[0]
    )


def test_bad_cameras_stand_before_an_object_that_cannot_be(tmp_path):
    folder = tmp_path / "set"
    write_set(folder, {"a": {}}, cameras=ring(4))
    (folder / "calibration.json").write_text(json.dumps({"episodes": {"a": {"cameras": VERDICTS}}}))
    with pytest.raises(PlopError) as caught:
        fuse(folder, tmp_path / "out", FuseConfig(max_extent_m=0.01))
    assert (
        caught.value.found.startswith("`plop calibrate` calls all 2 of its cameras")
        and "implausibly large" in caught.value.found
    )
    assert str(caught.value.fix).startswith("Repair the cameras first")


def thickness(points: np.ndarray) -> float:
    """Spread of the distance to the best-placed ellipsoid: translation is free."""
    from scipy.optimize import least_squares

    found = least_squares(lambda t: ellipsoid_distance(points + t), np.zeros(3), loss="soft_l1", f_scale=1e-3)
    return float(np.median(np.abs(ellipsoid_distance(points + found.x))))


@pytest.mark.parametrize("masks", [True, False])
def test_scan_becomes_one_cloud_without_the_table(tmp_path, masks):
    scan = ring(10, distance=0.3, height=0.2)
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(2), scan=scan, masks=masks, table_z_m=0.0 if masks else None)
    fuse(tmp_path / "set", tmp_path / "out")
    facts = json.loads((tmp_path / "out" / "fuse.json").read_text())["episodes"]["a"]
    cloud = read_cloud(tmp_path / "out" / "clouds" / "a.ply")
    assert facts["source"] == "scan" and facts["method"] == "tsdf"
    distance = np.abs(ellipsoid_distance(cloud.points))
    assert np.percentile(distance, 90 if masks else 75) < 2e-3
    assert cloud.points[:, 2].min() > (-0.003 if masks else 0.003)


def damage(folder: Path, change) -> None:
    with h5py.File(folder / "episodes" / "a.h5", "r+") as file:
        for name, camera in file["cameras"].items():
            change(name, camera)


def blank(key: str, value: float, only: str | None = None):
    def change(name, camera):
        if only in (None, name):
            camera[key][...] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (blank("mask", 0), "No camera sees the object"),
        (blank("depth_m", 0), "No camera sees the object"),
        (blank("depth_m", np.nan), "No camera sees the object"),
        (lambda name, camera: camera["depth_m"].__setitem__(..., camera["depth_m"][:] * 1000), "millimetres"),
        (blank("depth_m", -1), "negative"),
    ],
)
def test_bad_images_are_explained(tmp_path, change, message):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(3))
    damage(tmp_path / "set", change)
    with pytest.raises(PlopError, match=message):
        fuse(tmp_path / "set", tmp_path / "out")


def test_one_blind_camera_is_a_warning(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(4))
    damage(tmp_path / "set", blank("depth_m", 0, only="cam1"))
    summary = fuse(tmp_path / "set", tmp_path / "out")
    assert any("cam1" in warning for warning in summary.warnings)


def test_a_bad_episode_does_not_stop_the_others(tmp_path):
    write_set(tmp_path / "set", {"a": {}, "b": {}}, cameras=ring(4))
    damage(tmp_path / "set", blank("depth_m", 0))
    summary = fuse(tmp_path / "set", tmp_path / "out")
    assert summary.figures == summary.figures | {"episodes": 1, "skipped": 1}
    assert any("a was skipped" in warning for warning in summary.warnings)


@pytest.mark.parametrize("config", [FuseConfig(frame=99), FuseConfig(source="scan")])
def test_bad_settings_are_explained(tmp_path, config):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(2))
    with pytest.raises(PlopError):
        fuse(tmp_path / "set", tmp_path / "out", config)


def test_depth_beside_its_colour_is_warned_of_where_calibrate_has_not_judged(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring())
    assert not fuse(tmp_path / "set", tmp_path / "good").warnings
    with h5py.File(tmp_path / "set" / "episodes" / "a.h5", "r+") as file:
        name = sorted(file["cameras"])[0]
        depth = file[f"cameras/{name}/depth_m"]
        depth[0] = np.roll(depth[0], 12, axis=1)
    said = [text for text in fuse(tmp_path / "set", tmp_path / "out").warnings if "not aligned to colour" in text]
    assert len(said) == 1 and f"camera {name}" in said[0] and "plop calibrate" in said[0]
    (tmp_path / "set" / "calibration.json").write_text(json.dumps({"episodes": {}}))
    assert not any("not aligned" in text for text in fuse(tmp_path / "set", tmp_path / "judged").warnings)
