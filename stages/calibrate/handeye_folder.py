"""Read the poses of a hand-eye calibration from a folder, in any of three layouts.

    poses.json                      plop's own: {"mount": "wrist" or "fixed", "base_from_gripper": [4x4, ...],
                                    "cam_from_board": [4x4, ...]} or, instead of the latter, "images": [file names]
                                    of a board beside it
    robot_data*.yaml, marker_data*.yaml   handeye_calibration_ros2: "poses" with "rotation" 3x3 and "translation"
    pose_*/data.json                franka-handeye: O_T_EE (16 numbers, row by row), T_cam_target_rvec, _tvec

All lengths in metres. `mount` is "wrist" (camera on the gripper) unless poses.json says "fixed".
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from plop.errors import PlopError
from plop.geometry.boards import Board, board_pose, find_board


@dataclass(frozen=True)
class HandEyeData:
    """Robot and board poses at the same instants."""

    base_from_gripper: np.ndarray
    """[N, 4, 4] [m]"""
    cam_from_board: np.ndarray
    """[N, 4, 4] [m]"""
    mount: str
    """"wrist" or "fixed"."""
    missed: list[str]
    """Images in which no board was found."""


def read_handeye(folder: Path, *, board: Board | None = None, matrix: np.ndarray | None = None,
                 distortion: np.ndarray | None = None) -> HandEyeData:  # fmt: skip
    """Read a folder in whichever layout it has.

    Args:
        folder: See above.
        board: The board in the images of poses.json.
        matrix: K of the camera that took them, pixel centres at integers, shape [3, 3] [px].
        distortion: Its distortion, zeros when absent.

    Raises:
        PlopError: Nothing of the three layouts is there, a file is damaged, or no image shows the board.
    """
    try:
        if (folder / "poses.json").is_file():
            return _own(folder, board, matrix, np.zeros(5) if distortion is None else distortion)
        robots, markers = sorted(folder.glob("robot_data*.yaml")), sorted(folder.glob("marker_data*.yaml"))
        if robots and markers:
            return HandEyeData(_yaml_poses(robots[0]), _yaml_poses(markers[0]), "wrist", [])
        singles = sorted(folder.glob("pose_*/data.json"))
        if singles:
            robot, target = zip(*(_franka(path) for path in singles), strict=True)
            return HandEyeData(np.stack(robot), np.stack(target), "wrist", [])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise PlopError("The poses of a hand-eye calibration cannot be read.", where=folder,
                        expected="complete files as docs/stages/calibrate.md shows",
                        found=f"{type(error).__name__}: {error}") from error  # fmt: skip
    raise PlopError("There are no poses for a hand-eye calibration.", where=folder,
                    expected="poses.json, or robot_data*.yaml with marker_data*.yaml, or pose_*/data.json",
                    found="none of them", fix="See docs/stages/calibrate.md for the layouts.")  # fmt: skip


def _own(folder: Path, board: Board | None, matrix: np.ndarray | None, distortion: np.ndarray) -> HandEyeData:
    facts = json.loads((folder / "poses.json").read_text())
    robot = np.array(facts["base_from_gripper"], dtype=np.float64).reshape(-1, 4, 4)
    mount = facts.get("mount", "wrist")
    if mount not in ("wrist", "fixed"):
        raise PlopError("The mount of the camera is unknown.", where=folder / "poses.json",
                        expected='"wrist" or "fixed"', found=str(mount))  # fmt: skip
    if "cam_from_board" in facts:
        return HandEyeData(robot, np.array(facts["cam_from_board"], np.float64).reshape(-1, 4, 4), mount, [])
    if board is None or matrix is None:
        raise PlopError("Board images need a board and intrinsics.", where=folder / "poses.json",
                        expected="calibrate.board_* settings, and intrinsics from the recording or board images",
                        found="none")  # fmt: skip
    names = list(facts["images"])
    if len(names) != len(robot):
        raise PlopError("Robot poses and images do not pair up.", where=folder / "poses.json",
                        expected="as many of each", found=f"{len(robot)} poses, {len(names)} images")  # fmt: skip
    kept, poses, missed = [], [], []
    for index, name in enumerate(names):
        image = cv2.imread(str(_inside(folder, name)), cv2.IMREAD_COLOR)
        if image is None:
            raise PlopError("An image cannot be read.", where=folder / name, expected="a whole image file")
        corners = find_board(image, board)
        if corners is None:
            missed.append(name)
            continue
        kept.append(index)
        poses.append(board_pose(corners, matrix, distortion)[0])
    if not poses:
        raise PlopError("The board is found in no image.", where=folder, expected=f"a {board.kind} in each image",
                        found=f"none in {len(names)}", fix="Check the calibrate.board_* settings.")  # fmt: skip
    return HandEyeData(robot[kept], np.stack(poses), mount, missed)


def _inside(folder: Path, name: str) -> Path:
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise PlopError("An image lies outside its folder.", where=folder / "poses.json", expected="a plain file name",
                        found=name)  # fmt: skip
    return path


def _yaml_poses(path: Path) -> np.ndarray:
    import yaml

    rows: list[Any] = yaml.safe_load(path.read_text())["poses"]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    for pose, row in zip(poses, rows, strict=True):
        pose[:3, :3], pose[:3, 3] = np.reshape(row["rotation"], (3, 3)), row["translation"]
    return poses


def _franka(path: Path) -> tuple[np.ndarray, np.ndarray]:
    facts = json.loads(path.read_text())
    target = np.eye(4)
    target[:3, :3] = cv2.Rodrigues(np.array(facts["T_cam_target_rvec"], dtype=np.float64))[0]
    target[:3, 3] = np.array(facts["T_cam_target_tvec"]).reshape(3)
    return np.array(facts["O_T_EE"], dtype=np.float64).reshape(4, 4), target
