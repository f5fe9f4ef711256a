"""calibrate with hand-eye data: what is judged wrong moves no camera, other formats are read, bad files are named."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import h5py
import numpy as np
import pytest
import yaml

from plop.errors import PlopError
from plop.geometry.calibration.board_intrinsics import calibrate_intrinsics
from plop.geometry.calibration.boards import Board, find_board, settle_pattern
from plop.geometry.handeye.solve import difference
from plop.geometry.rigid import invert_rigid
from plop.recordings.set import RecordingSet
from stages.calibrate.handeye_finished import read_finished
from stages.calibrate.handeye_folder import read_handeye
from stages.calibrate.stage import CalibrateConfig
from tests.calibrate.test_calibrate_inputs import calibrate, handeye_folder
from tests.calibrate.test_calibrate_stage import moved
from tests.geometry.test_boards import MATRIX, photograph, poses
from tests.geometry.test_handeye import robot_poses
from tests.support.ellipsoid_scene import ring, write_set
from tests.support.handeye_sets import draw_rig, stretched

RIG = draw_rig(4, mount="fixed", pairs=14, noise_mm=0.3, noise_deg=0.02, turn_deg=35)


def board_seen_by(camera, noise_mm=0.1):
    """Board poses of a fixed camera of the scene, with the rig's motion."""
    place = invert_rigid(RIG.robot[0]) @ RIG.answer @ RIG.board[0]
    board = invert_rigid(camera.world_from_cam) @ RIG.robot @ place
    board[:, :3, 3] += np.random.default_rng(0).normal(0, noise_mm / 1e3, (len(board), 3))
    return board


def write_poses(tmp_path, robot, board, mount="fixed"):
    return handeye_folder(
        tmp_path, np.eye(4), base_from_gripper=robot.tolist(), cam_from_board=board.tolist(), mount=mount
    )


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize(
    ("change", "word"),
    [(lambda r, b: (invert_rigid(r), b), "inverted"), (lambda r, b: (r, stretched(b, 1.2)), "scale 0.83")],
)
def test_a_wrong_hand_eye_answer_moves_no_camera(tmp_path, count, change, word):
    cameras = ring(count)
    write_set(tmp_path / "set", {"a": {}}, cameras=cameras)
    summary, facts = calibrate(tmp_path, handeye=write_poses(tmp_path, *change(RIG.robot, board_seen_by(cameras[0]))))
    entry = facts["cameras"]["cam0"]
    assert entry["verdict"] == "good" and word in entry["fix"] and not facts["handeye"]["cam0"]["used"]
    assert any("was not used" in warning and word in warning for warning in summary.warnings)
    assert summary.table[0]["handeye_spread_mm"] > 5 and summary.table[0]["handeye_method"]
    assert summary.table[1]["handeye_method"] is None
    with RecordingSet.load(tmp_path / "out").open("a") as recording:
        for camera in cameras:
            assert np.array_equal(recording.camera(camera.name, 0).world_from_cam, camera.world_from_cam)
    assert {each["verdict"] for each in facts["cameras"].values()} == {"good"}
    assert {each["depth_scale"] for each in facts["cameras"].values()} == {1.0}


def test_a_fitted_board_scale_is_used_where_it_is_asked_for(tmp_path):
    cameras = ring(3)
    write_set(tmp_path / "set", {"a": {}}, cameras=cameras)
    folder = write_poses(tmp_path, RIG.robot, stretched(board_seen_by(cameras[0]), 1.2))
    summary, facts = calibrate(tmp_path, CalibrateConfig(fit_board_scale=True), handeye=folder)
    assert facts["handeye"]["cam0"]["used"] and any("scaled by it" in each for each in summary.warnings)
    assert difference(np.array(facts["handeye"]["cam0"]["transform"]), cameras[0].world_from_cam)[1] < 1


def test_two_cameras_that_disagree_are_not_moved_onto_each_other(tmp_path):
    cameras = ring(2)
    write_set(tmp_path / "set", {"a": {}}, cameras=[cameras[0], moved(cameras[1], (8, -6, 5))], truth=cameras)
    _, facts = calibrate(tmp_path)
    assert {each["verdict"] for each in facts["cameras"].values()} == {"bad"}
    assert all("nobody can tell" in each["fix"] for each in facts["cameras"].values())
    with RecordingSet.load(tmp_path / "out").open("a") as recording:
        assert np.array_equal(recording.camera("cam0", 0).world_from_cam, cameras[0].world_from_cam)


def test_a_sound_hand_eye_pose_tells_which_of_two_cameras_is_wrong(tmp_path):
    cameras = ring(2)
    write_set(tmp_path / "set", {"a": {}}, cameras=[cameras[0], moved(cameras[1], (8, -6, 5))], truth=cameras)
    _, facts = calibrate(tmp_path, handeye=write_poses(tmp_path, RIG.robot, board_seen_by(cameras[0])))
    assert facts["cameras"]["cam0"]["verdict"] == "good" and facts["cameras"]["cam1"]["verdict"] == "corrected"


def test_of_three_cameras_the_two_that_agree_stay(tmp_path):
    cameras = ring(3)
    write_set(tmp_path / "set", {"a": {}}, cameras=[moved(cameras[0], (9, -6, 5)), *cameras[1:]], truth=cameras)
    _, facts = calibrate(tmp_path)
    assert [facts["cameras"][f"cam{i}"]["verdict"] for i in range(3)] == ["corrected", "good", "good"]
    with RecordingSet.load(tmp_path / "out").open("a") as recording:
        for camera in cameras[1:]:
            assert np.array_equal(recording.camera(camera.name, 0).world_from_cam, camera.world_from_cam)


@pytest.mark.parametrize("written", ["world_from_cam", "base_from_cam"])
def test_a_finished_pose_places_a_camera(tmp_path, written):
    cameras = ring(3)
    wrong = [replace(cameras[0], world_from_cam=np.diag([1.0, -1, -1, 1])), *cameras[1:]]
    write_set(tmp_path / "set", {"a": {}}, cameras=wrong, truth=cameras)
    (tmp_path / "poses" / "cam0").mkdir(parents=True)
    content = json.dumps({written: cameras[0].world_from_cam.T.ravel().tolist()})  # column-major
    (tmp_path / "poses" / "cam0" / "poses.json").write_text("\ufeff" + content)
    summary, facts = calibrate(tmp_path, handeye=tmp_path / "poses")
    assert facts["cameras"]["cam0"]["verdict"] == "good" and facts["cameras"]["cam0"]["handeye_method"] == "given"
    assert any("column-major" in each for each in summary.warnings)


def test_a_finished_pose_that_contradicts_right_cameras_is_not_used(tmp_path):
    """ROS body axes: nothing but the other cameras can tell."""
    cameras = ring(3)
    write_set(tmp_path / "set", {"a": {}}, cameras=cameras)
    (tmp_path / "poses" / "cam0").mkdir(parents=True)
    body = cameras[0].world_from_cam @ np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
    (tmp_path / "poses" / "cam0" / "poses.json").write_text(json.dumps({"world_from_cam": body.tolist()}))
    _, facts = calibrate(tmp_path, handeye=tmp_path / "poses")
    assert facts["cameras"]["cam0"]["verdict"] == "good" and "check its axes" in facts["cameras"]["cam0"]["fix"]


def easy(folder, name, content):
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(yaml.safe_dump(content))
    return folder


@pytest.mark.parametrize("kind", ["eye_on_base", "eye_in_hand"])
def test_results_of_easy_handeye_are_read(tmp_path, kind):
    place, quat = {"x": 0.7, "y": -0.4, "z": 0.5}, {"x": 0.5, "y": 0.5, "z": -0.5, "w": 0.5}
    new = {
        "parameters": {"calibration_type": kind, "tracking_base_frame": "camera_color_optical_frame"},
        "transform": {"translation": place, "rotation": quat},
    }
    old = {
        "parameters": {"eye_on_hand": kind == "eye_in_hand", "tracking_base_frame": "cam_optical"},
        "transformation": {**place, **{f"q{axis}": value for axis, value in quat.items()}},
    }
    found = [read_finished(easy(tmp_path / "a", "rig.calib", new)), read_finished(easy(tmp_path / "b", "r.yaml", old))]
    for each in found:
        assert each is not None and each.mount == ("fixed" if kind == "eye_on_base" else "wrist") and not each.notes
        np.testing.assert_allclose(each.transform[:3, 3], [0.7, -0.4, 0.5])
        np.testing.assert_allclose(each.transform[:3, :3] @ [1, 0, 0], [0, 0, -1], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c["parameters"].update(tracking_base_frame="camera_link"), "without camera axes"),
        (lambda c: c["transform"]["translation"].update(x=700.0), "millimetres"),
        (lambda c: c["transform"]["rotation"].update(w=0.9), "length 1"),
        (lambda c: c["transform"]["translation"].update(x=float("nan")), "not finite"),
        (lambda c: c["transform"].pop("rotation"), "rotation"),
    ],
)
def test_finished_poses_that_cannot_be_are_refused(tmp_path, change, message):
    content = {
        "parameters": {"calibration_type": "eye_on_base", "tracking_base_frame": "optical"},
        "transform": {
            "translation": {"x": 0.7, "y": 0.0, "z": 0.5},
            "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        },
    }
    change(content)
    with pytest.raises(PlopError, match=message):
        read_finished(easy(tmp_path / "a", "rig.calib", content))


def ros2(folder, robot, board):
    for name, poses_ in (("robot_data", robot), ("marker_data", board)):
        rows = [{"rotation": pose[:3, :3].tolist(), "translation": pose[:3, 3].tolist()} for pose in poses_]
        easy(folder, f"{name}.yaml", {"poses": rows})
    return folder


def test_the_mount_of_files_that_do_not_say_it(tmp_path):
    folder = ros2(tmp_path / "cam0", RIG.robot, RIG.board)
    assert read_handeye(folder).mount == "wrist"
    assert read_handeye(folder, mount="fixed").mount == "fixed"
    (folder / "mount").write_text("fixed\n")
    assert read_handeye(folder).mount == "fixed"
    contradicted = read_handeye(folder, mount="wrist")
    assert contradicted.mount == "wrist" and "handeye_mount" in contradicted.notes[0]


def damaged(tmp_path, kind):
    robot, board = RIG.robot.copy(), RIG.board.copy()
    if kind == "nan":
        board[3, 0, 3] = np.nan
    folder = ros2(tmp_path / "poses" / "cam0", robot, board[:-1] if kind == "fewer" else board)
    if kind == "empty":
        (folder / "marker_data.yaml").write_text("")
    if kind == "no yaml":
        (folder / "marker_data.yaml").write_text("poses: [{")
    if kind == "list":
        (folder / "marker_data.yaml").write_text("- 1")


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("nan", "pose 3"),
        ("fewer", "14 robot poses, 13 board poses"),
        ("empty", "is empty"),
        ("no yaml", "marker_data"),
        ("list", "cannot be read"),
    ],
)
def test_damaged_files_are_named(tmp_path, kind, message):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(2))
    (tmp_path / "poses").mkdir()
    damaged(tmp_path, kind)
    with pytest.raises(PlopError, match=message):
        calibrate(tmp_path, handeye=tmp_path / "poses")


def test_degrees_in_a_rotation_vector_are_named(tmp_path):
    (tmp_path / "pose_0").mkdir()
    (tmp_path / "pose_0" / "data.json").write_text(
        json.dumps({"O_T_EE": np.eye(4).tolist(), "T_cam_target_rvec": [80, 10, 5], "T_cam_target_tvec": [0, 0, 1]})
    )
    with pytest.raises(PlopError, match="degrees"):
        read_handeye(tmp_path)


def test_a_folder_that_names_no_camera_is_told(tmp_path):
    cameras = ring(2)
    write_set(tmp_path / "set", {"a": {}}, cameras=cameras)
    folder = write_poses(tmp_path, RIG.robot, board_seen_by(cameras[0]))
    (folder / "cam7").mkdir()
    summary, _ = calibrate(tmp_path, handeye=folder)
    assert any("cam7 names no camera" in each for each in summary.warnings)


def test_a_fixed_pose_for_a_camera_that_moves_is_refused(tmp_path):
    cameras = ring(2)
    write_set(tmp_path / "set", {"a": {}}, cameras=cameras)
    with h5py.File(tmp_path / "set" / "episodes" / "a.h5", "r+") as file:
        file["cameras/cam0/world_from_cam"][1, 0, 3] += 0.2
    with pytest.raises(PlopError, match="fixed camera moves"):
        calibrate(tmp_path, handeye=write_poses(tmp_path, RIG.robot, board_seen_by(cameras[0])))


@pytest.mark.parametrize("legacy", [False, True])
def test_both_patterns_of_an_even_charuco_board_are_found(legacy):
    told, drawn = Board("charuco", 6, 4, 0.034, 0.026), Board("charuco", 6, 4, 0.034, 0.026, legacy=legacy)
    images = {f"{i}": photograph(drawn, pose) for i, pose in enumerate(poses(4))}
    assert settle_pattern(images.values(), told).legacy == legacy
    found = calibrate_intrinsics(images, told)
    assert found.board.legacy == legacy and len(found.used) >= 3 and found.rms_px < 0.3


def test_a_board_that_is_not_found_says_what_was_tried():
    images = {f"{i}": photograph(Board("charuco", 6, 4, 0.034, 0.026), pose) for i, pose in enumerate(poses(4))}
    with pytest.raises(PlopError, match="4 x 6 squares.*legacy.*with 6 x 4 it is found in"):
        calibrate_intrinsics(images, Board("charuco", 4, 6, 0.034, 0.026))
    with pytest.raises(PlopError, match="DICT_6X6_50"):
        calibrate_intrinsics(images, Board("charuco", 6, 4, 0.034, 0.026, "DICT_6X6_50"))


def test_hand_eye_images_of_a_legacy_board_are_read(tmp_path):
    drawn = Board("charuco", 6, 4, 0.034, 0.026, legacy=True)
    for i, pose in enumerate(poses(4)):
        cv2.imwrite(str(tmp_path / f"{i}.png"), photograph(drawn, pose))
    (tmp_path / "poses.json").write_text(
        json.dumps({"base_from_gripper": robot_poses(4).tolist(), "images": [f"{i}.png" for i in range(4)]})
    )
    data = read_handeye(tmp_path, board=replace(drawn, legacy=False), matrix=MATRIX)
    assert len(data.cam_from_board) >= 3 and "legacy" in data.notes[0]
    assert find_board(photograph(drawn, poses(1)[0]), drawn) is not None
