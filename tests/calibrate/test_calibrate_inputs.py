"""calibrate with board images, hand-eye poses, a late camera and a disturbed scan."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.handeye.solve import HAND_EYE_METHODS, difference
from plop.geometry.pose_track import poses_at
from plop.geometry.rigid import invert_rigid, pose_from_euler_xyz
from plop.geometry.view import MaskLabel
from plop.pipeline.settings import resolve
from plop.pipeline.stage import Input, Output
from plop.recordings.recording import Mesh
from plop.recordings.set import RecordingSet
from plop.recordings.writer import RecordingWriter
from plop.sensors.silhouette import outline
from plop.setting_kinds import kinds_of
from stages.calibrate import tool_timing
from stages.calibrate.handeye_folder import read_handeye
from stages.calibrate.stage import STAGE, CalibrateConfig
from stages.calibrate.tool_timing import episode_offsets
from tests.geometry.test_boards import CHARUCO, MATRIX, photograph, poses
from tests.geometry.test_handeye import robot_poses
from tests.support.box import BOX_FACES
from tests.support.ellipsoid_scene import ring, write_set

BLADE = Mesh(np.array([[x, y, z] for x in (0, 0.06) for y in (0, 0.004) for z in (0, 0.05)], float), BOX_FACES)


def calibrate(tmp_path, config=None, **folders):
    out = tmp_path / "out"
    out.mkdir(exist_ok=True)
    inputs = {"recordings": Input(tmp_path / "set"), **{name: Input(path) for name, path in folders.items()}}
    summary = STAGE.run(inputs, config or CalibrateConfig(), Output(out))
    return summary, json.loads((out / "calibration.json").read_text())


def write_moving_tool(path, cameras, lag_s):
    """Film a falling blade; the images show where it was `lag_s` before their time stamps say."""
    time = np.arange(30) / 30
    motion = np.tile(np.eye(4), (len(time), 1, 1))
    motion[:, :3, 3] = np.stack([0.03 * np.sin(4 * time), 0 * time, 0.12 - 0.1 * time], 1) - [0.03, 0, 0]
    with RecordingWriter(
        path,
        name=path.stem,
        source="test",
        environment="scene",
        table_z_m=None,
        time_s=time,
        tool_mesh=BLADE,
        world_from_tool=motion,
    ) as writer:
        for camera in cameras:
            writer.add_camera(
                camera.name,
                camera.intrinsics,
                np.tile(camera.world_from_cam, (len(time), 1, 1)),
                camera.height,
                camera.width,
            )
            for frame, pose in enumerate(poses_at(time, motion, time - lag_s)):
                mask = np.where(outline(BLADE, pose, camera), MaskLabel.TOOL, 0).astype(np.uint8)
                mask[-2:] = MaskLabel.OBJECT
                depth = np.full(mask.shape, 0.4, np.float32)
                writer.write_frame(camera.name, frame, np.zeros((*mask.shape, 3), np.uint8), depth, mask)


@pytest.mark.parametrize("lag_ms", [0, 50, -70])
def test_a_late_camera_is_timed(tmp_path, lag_ms):
    write_moving_tool(tmp_path / "set" / "episodes" / "a.h5", ring(2), lag_ms / 1e3)
    RecordingSet(tmp_path / "set", "scene", ["a"], []).save()
    with RecordingSet.load(tmp_path / "set").open("a") as recording:
        found = episode_offsets(recording, 200)
        assert [each.offset_ms for each in found.values()] == pytest.approx([lag_ms] * 2, abs=10)
        still = recording.world_from_tool
    _, facts = calibrate(tmp_path)
    with RecordingSet.load(tmp_path / "out").open("a") as recording:
        moved = np.abs(recording.world_from_tool - still).max()
    entry = facts["cameras"]["cam0"]
    assert entry["time_offset_ms"] == pytest.approx(lag_ms, abs=10)
    assert (moved > 0.002 and "lag" in entry["fix"]) if lag_ms else moved == 0


@pytest.mark.parametrize(("wrong", "without", "told"), [(12, 14, False), (65, 222, True), (0, 0, False), (0, 16, True)])
def test_an_offset_is_told_by_more_pixels_than_chance(tmp_path, monkeypatch, wrong, without, told):
    """A late camera is believed where its outlines are better by more than chance, and has no resolution else."""
    write_moving_tool(tmp_path / "set" / "episodes" / "a.h5", ring(1), 0.05)
    RecordingSet(tmp_path / "set", "scene", ["a"], []).save()
    assert tool_timing._fits_better(wrong, without) == told
    monkeypatch.setattr(tool_timing, "_fits_better", lambda *_: told)
    with RecordingSet.load(tmp_path / "set").open("a") as recording:
        (offset,) = episode_offsets(recording, 200).values()
    assert (abs(offset.offset_ms) > offset.resolution_ms) == told


def test_board_images_replace_intrinsics(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=[replace(c, width=128, height=96) for c in ring(2)])
    folder = tmp_path / "boards" / "cam0"
    folder.mkdir(parents=True)
    for index, pose in enumerate(poses(6)):
        cv2.imwrite(str(folder / f"{index}.png"), photograph(CHARUCO, pose))
    _, facts = calibrate(tmp_path, CalibrateConfig(correct=False), board_images=tmp_path / "boards")
    assert facts["intrinsics"]["cam0"]["rms_px"] < 0.15
    assert facts["cameras"]["cam0"]["reprojection_px"] == facts["intrinsics"]["cam0"]["rms_px"]
    with RecordingSet.load(tmp_path / "out").open("a") as recording:
        found = recording.camera("cam0", 0).intrinsics
        np.testing.assert_allclose(found[0, 0], MATRIX[0, 0] / 5, atol=1)
        np.testing.assert_allclose(found[0, 2], (MATRIX[0, 2] + 0.5) / 5, atol=1)


def handeye_folder(tmp_path, base_from_cam, **facts):
    """Poses of a fixed camera that watches a board in the gripper."""
    robot = robot_poses()
    board = invert_rigid(base_from_cam) @ robot @ pose_from_euler_xyz(np.array([0, 0.02, 0.1, 0.2, 0.1, 0]))
    folder = tmp_path / "poses" / "cam0"
    folder.mkdir(parents=True)
    content = {"mount": "fixed", "base_from_gripper": robot.tolist(), "cam_from_board": board.tolist(), **facts}
    (folder / "poses.json").write_text(json.dumps(content))
    return tmp_path / "poses"


def test_hand_eye_poses_place_a_fixed_camera(tmp_path):
    cameras = ring(4)
    wrong = [replace(cameras[0], world_from_cam=np.diag([1.0, -1, -1, 1])), *cameras[1:]]
    write_set(tmp_path / "set", {"a": {}}, cameras=wrong, truth=cameras)
    _, facts = calibrate(tmp_path, handeye=handeye_folder(tmp_path, cameras[0].world_from_cam))
    assert facts["handeye"]["cam0"]["method"] and len(facts["handeye"]["cam0"]["methods"]) == 5
    assert facts["cameras"]["cam0"]["verdict"] == "good"
    with RecordingSet.load(tmp_path / "out").open("a") as recording:
        assert max(difference(recording.camera("cam0", 1).world_from_cam, cameras[0].world_from_cam)) < 1e-2


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"base_from_gripper": []}, "not as many robot poses"),
        ({"mount": "ceiling"}, "mount"),
        ({"cam_from_board": [[1, 2], [3]]}, "cannot be read"),
    ],
)
def test_bad_hand_eye_folders_are_explained(tmp_path, facts, message):
    cameras = ring(3)
    write_set(tmp_path / "set", {"a": {}}, cameras=cameras)
    with pytest.raises(PlopError, match=message):
        calibrate(tmp_path, handeye=handeye_folder(tmp_path, cameras[0].world_from_cam, **facts))


def test_missing_folders_are_explained(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(2))
    for name in ("board_images", "handeye"):
        with pytest.raises(PlopError, match="named after a camera"):
            calibrate(tmp_path, **{name: tmp_path / "nothing"})
    (tmp_path / "empty").mkdir()
    with pytest.raises(PlopError, match="no poses"):
        read_handeye(tmp_path / "empty")
    (tmp_path / "outside.png").touch()
    (tmp_path / "empty" / "poses.json").write_text(
        json.dumps({"base_from_gripper": [np.eye(4).tolist()], "images": ["../outside.png"]})
    )
    with pytest.raises(PlopError, match="outside"):
        read_handeye(tmp_path / "empty", board=CHARUCO, matrix=MATRIX)


def test_a_disturbed_scan_is_bad_and_a_right_one_good(tmp_path):
    scan = ring(12, distance=0.3, height=0.2)
    draw = np.random.default_rng(0)
    shifts = pose_from_euler_xyz(np.pad(0.02 * draw.normal(size=(len(scan), 3)), ((0, 0), (0, 3))))
    bent = [replace(c, world_from_cam=shift @ c.world_from_cam) for c, shift in zip(scan, shifts)]
    write_set(tmp_path / "set", {"a": {"scan": scan}, "b": {"scan": bent, "scan_truth": scan}}, cameras=ring(2))
    summary, facts = calibrate(tmp_path, CalibrateConfig(refine_scan="never"))
    assert facts["episodes"]["a"]["scan"][0]["verdict"] == "good"
    assert facts["episodes"]["b"]["scan"][0]["verdict"] == "bad"
    assert any("scan wrist (b)" in warning for warning in summary.warnings)


def test_every_method_of_hand_eye_calibration_can_be_chosen():
    assert kinds_of(CalibrateConfig)["hand_eye_method"].choices == ("auto", *HAND_EYE_METHODS)


def test_a_board_that_cannot_be_is_refused_by_the_name_of_the_setting():
    with pytest.raises(PlopError, match="too few squares") as caught:
        resolve(CalibrateConfig, "calibrate", ("--set", {"board_columns": 2}))
    assert caught.value.where == "calibrate: board_columns, board_rows" and caught.value.fix
