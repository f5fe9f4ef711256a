"""Hand-eye data as people have them: inverted poses, another board, other layouts, finished poses, legacy boards."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from plop.geometry.boards import Board
from plop.geometry.rigid import invert_rigid, pose_from_euler_xyz
from plop.recordings.set import RecordingSet
from tests.cases.case import Case, Done
from tests.geometry.test_boards import photograph, poses
from tests.support.droid_scene import EXT1, EXT2, Scene, exterior_poses, make_episode
from tests.support.handeye_sets import draw_rig, stretched

TRUTH = exterior_poses()
COMMANDS = ("ingest droid raw -q", "calibrate --handeye poses")
NOT_USED = "its hand-eye pose was not used, the recorded one stays"


def pairs() -> tuple[np.ndarray, np.ndarray]:
    """Robot and board poses of the fixed camera EXT1, 0.2 mm of noise."""
    robot = draw_rig(5, mount="fixed", pairs=14, turn_deg=35).robot
    board = invert_rigid(TRUTH[EXT1]) @ robot @ pose_from_euler_xyz(np.array([0.02, -0.03, 0.06, 0.1, -0.2, 0.3]))
    board[:, :3, 3] += np.random.default_rng(0).normal(0, 0.0002, (14, 3))
    return robot, board


def episode(folder: Path) -> Path:
    make_episode(folder / "raw", rows=6, serials=(EXT1, EXT2), scene=Scene(96, 72, 90.0))
    camera = folder / "poses" / EXT1
    camera.mkdir(parents=True)
    return camera


def as_poses(
    change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]], mount: str = "fixed"
) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        robot, board = change(*pairs())
        content = {"mount": mount, "base_from_gripper": robot.tolist(), "cam_from_board": board.tolist()}
        (episode(folder) / "poses.json").write_text(json.dumps(content))

    return make


def as_franka(folder: Path) -> None:
    camera = episode(folder)
    for i, (robot, board) in enumerate(zip(*pairs(), strict=True)):
        (camera / f"pose_{i}").mkdir()
        (camera / f"pose_{i}" / "data.json").write_text(
            json.dumps(
                {
                    "O_T_EE": robot.T.ravel().tolist(),
                    "T_cam_target_tvec": board[:3, 3].tolist(),
                    "T_cam_target_rvec": Rotation.from_matrix(board[:3, :3]).as_rotvec().tolist(),
                }
            )
        )


def as_ros2(folder: Path) -> None:
    camera = episode(folder)
    for name, stack in zip(("robot_data", "marker_data"), pairs(), strict=True):
        rows = [{"rotation": pose[:3, :3].tolist(), "translation": pose[:3, 3].tolist()} for pose in stack]
        (camera / f"{name}.yaml").write_text(yaml.safe_dump({"poses": rows}))


def as_easy_handeye(folder: Path) -> None:
    pose = TRUTH[EXT1]
    quat = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    content = {
        "parameters": {"calibration_type": "eye_on_base", "tracking_base_frame": "camera_color_optical_frame"},
        "transform": {
            "translation": dict(zip("xyz", pose[:3, 3].tolist(), strict=True)),
            "rotation": dict(zip("xyzw", quat, strict=True)),
        },
    }
    (episode(folder) / "rig.calib").write_text(yaml.safe_dump(content))


def as_legacy_board(folder: Path) -> None:
    episode(folder)
    (folder / "boards" / EXT1).mkdir(parents=True)
    board = Board("charuco", 6, 4, 0.034, 0.026, legacy=True)
    for i, pose in enumerate(poses(4)):
        cv2.imwrite(str(folder / "boards" / EXT1 / f"{i}.png"), photograph(board, pose))


def cameras_stay(done: Done) -> None:
    """The cameras are where the recording, which is right, has them."""
    with RecordingSet.load(done.store.find("calibrate@latest").path).open(_name(done)) as recording:
        for name, truth in TRUTH.items():
            np.testing.assert_allclose(recording.camera(name, 0).world_from_cam, truth, atol=2e-3)


def _name(done: Done) -> str:
    return RecordingSet.load(done.store.find("calibrate@latest").path).names[0]


def refused(
    name: str, source: str, make: Callable[[Path], None], *words: str, commands: tuple[str, ...] = COMMANDS
) -> Case:
    return Case(
        name, source, make, commands, warned=(NOT_USED, *words), never=("nan", "corrected here"), right=cameras_stay
    )


def used(
    name: str, source: str, make: Callable[[Path], None], *words: str, commands: tuple[str, ...] = COMMANDS
) -> Case:
    return Case(name, source, make, commands, warned=words, never=("nan", NOT_USED), right=cameras_stay)


CASES = [
    used("handeye_control", "own", as_poses(lambda r, b: (r, b)), "handeye"),
    refused(
        "handeye_mount_left_at_wrist",
        "moveit/moveit_calibration pose_samples.json",
        as_poses(lambda r, b: (r, b), "wrist"),
        'mount "fixed"',
    ),
    refused(
        "handeye_inverted_robot",
        "opencv/opencv#20974",
        as_poses(lambda r, b: (invert_rigid(r), b)),
        "if the robot poses are inverted (gripper_from_base)",
    ),
    refused(
        "handeye_board_size_wrong",
        "moveit/moveit_calibration#38",
        as_poses(lambda r, b: (r, stretched(b, 1.2))),
        "the board's size is wrong: scale 0.83",
    ),
    used(
        "handeye_column_major",
        "libfranka robot_state.h",
        as_poses(lambda r, b: (np.swapaxes(r, 1, 2), np.swapaxes(b, 1, 2))),
        "column-major: transposed",
    ),
    used(
        "handeye_franka_column_major",
        "libfranka robot_state.h",
        as_franka,
        "column-major: transposed",
        commands=(COMMANDS[0], COMMANDS[1] + " --handeye-mount fixed"),
    ),
    used("handeye_easy_handeye_result", "IFL-CAMP/easy_handeye#85", as_easy_handeye, "given"),
    refused(
        "handeye_ros2_yaml_mount_not_said",
        "shengyangzhuang/handeye_calibration_ros2#1",
        as_ros2,
        "--handeye-mount fixed",
    ),
    used(
        "handeye_ros2_yaml_eye_to_hand",
        "shengyangzhuang/handeye_calibration_ros2#1",
        as_ros2,
        commands=(COMMANDS[0], COMMANDS[1] + " --handeye-mount fixed"),
    ),
    Case(
        "charuco_legacy_even_rows",
        "opencv/opencv#23152",
        as_legacy_board,
        (
            COMMANDS[0],
            "calibrate --board-images boards --board-columns 6 --board-rows 4 --board-marker-m 0.026 "
            "--max-disagreement-mm 100",
        ),
        warned=("legacy pattern",),
    ),
]
