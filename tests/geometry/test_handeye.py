"""Hand-eye calibration: a known answer, real data with published answers, and motion that cannot tell."""

from __future__ import annotations

import json

import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.handeye.solve import HAND_EYE_METHODS, difference, hand_eye, robot_world
from plop.geometry.rigid import invert_rigid, pose_from_euler_xyz
from stages.calibrate.handeye_folder import read_handeye

CAMERA = pose_from_euler_xyz(np.array([0.05, -0.02, 0.07, 0.1, -0.2, 1.5]))
BOARD = pose_from_euler_xyz(np.array([0.5, 0.1, 0.0, 0.0, 0.0, 0.3]))


def robot_poses(count=12, turn=0.5, seed=0):
    draw = np.random.default_rng(seed)
    parts = np.concatenate(
        [draw.uniform(-0.1, 0.1, (count, 3)) + [0.4, 0, 0.4], draw.uniform(-turn, turn, (count, 3)) + [np.pi, 0, 0]],
        axis=1,
    )
    return pose_from_euler_xyz(parts)


def board_poses(robot, noise_m=0.0, seed=1):
    draw = np.random.default_rng(seed)
    exact = invert_rigid(robot @ CAMERA) @ BOARD
    wobble = pose_from_euler_xyz(noise_m * draw.normal(size=(len(robot), 6)))
    return exact @ wobble


@pytest.mark.parametrize("method", list(HAND_EYE_METHODS))
def test_every_method_finds_an_exact_answer(method):
    robot = robot_poses()
    found = hand_eye(robot, board_poses(robot), methods=[method])
    assert difference(found.result, CAMERA) < (1e-4, 1e-3)
    assert found.scores[0].spread_mm < 1e-3


def test_robot_world_finds_the_same():
    robot = robot_poses()
    assert max(difference(robot_world(robot, board_poses(robot)).result, CAMERA)) < 1e-3


def test_a_fixed_camera_with_the_board_in_the_gripper():
    robot, base_from_cam = robot_poses(), pose_from_euler_xyz(np.array([1.0, 0.2, 0.6, -2.0, 0.1, 1.4]))
    gripper_from_board = pose_from_euler_xyz(np.array([0.0, 0.02, 0.1, 0.2, 0.1, 0.0]))
    board = invert_rigid(base_from_cam) @ robot @ gripper_from_board
    assert max(difference(hand_eye(robot, board, mount="fixed").result, base_from_cam)) < 1e-3


def test_noise_moves_the_answer_little_and_the_choice_is_the_most_consistent():
    robot = robot_poses(20)
    found = hand_eye(robot, board_poses(robot, 0.001))
    angle, distance = difference(found.result, CAMERA)
    assert angle < 0.2 and distance < 2
    assert found.scores[0].score == min(each.score for each in found.scores)


@pytest.mark.parametrize(
    ("robot", "message"),
    [
        (robot_poses(3), "too few poses"),
        (robot_poses(8, turn=0.0), "hardly rotates"),
        (np.where(np.eye(4, dtype=bool), robot_poses(8), np.nan), "not finite"),
        (robot_poses(8) * np.array([1, 1, 1, 1000.0]), "millimetres"),
    ],
)
def test_poses_that_cannot_tell_are_refused(robot, message):
    board = board_poses(robot_poses(len(robot), turn=0.0 if "turns" in message else 0.5))
    with pytest.raises(PlopError, match=message):
        hand_eye(robot, board)


def test_turning_about_one_axis_only_is_refused():
    parts = np.tile([0.4, 0, 0.4, np.pi, 0, 0], (8, 1)).astype(float)
    parts[:, 5] = np.linspace(-0.5, 0.5, 8)
    robot = pose_from_euler_xyz(parts)
    with pytest.raises(PlopError, match="one axis only"):
        hand_eye(robot, board_poses(robot))


def test_unpaired_poses_are_refused():
    robot = robot_poses()
    with pytest.raises(PlopError, match="not as many robot poses"):
        hand_eye(robot, board_poses(robot)[:-1])


def test_realsense_tsai_reproduces_the_published_transform(shared_data):
    folder = shared_data / "handeye_ros2_realsense" / "handeye_realsense" / "resource"
    data = read_handeye(folder)
    published = read_published_yaml(folder / "handeye_result_realsense.yaml")
    angle, distance = difference(
        hand_eye(data.base_from_gripper, data.cam_from_board, methods=["TSAI"]).result, published
    )
    assert round(angle, 4) == 0 and round(distance, 3) == 0
    chosen = hand_eye(data.base_from_gripper, data.cam_from_board)
    assert chosen.method != "ANDREFF" and difference(chosen.result, published) < (0.2, 1.0)


def read_published_yaml(path):
    numbers = [float(line[2:]) for line in path.read_text().splitlines() if line.startswith("- ")]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.reshape(numbers[:9], (3, 3)), numbers[9:]
    return pose


def test_franka_choice_is_daniilidis_and_near_the_published_answer(shared_data):
    folder = shared_data / "franka_handeye" / "data"
    data = read_handeye(folder / "captured-data")
    result = folder / "hand-eye-calibration-output" / "calibration_result.json"
    published = np.array(json.loads(result.read_text())["T_cam_gripper"])
    chosen = hand_eye(data.base_from_gripper, data.cam_from_board)
    assert chosen.method == "DANIILIDIS" and chosen.scores[-1].method == "ANDREFF"
    angle, distance = difference(chosen.result, published)
    assert angle <= 0.05 and distance <= 0.415
    assert difference(chosen.scores[-1].result, published)[1] > 10
