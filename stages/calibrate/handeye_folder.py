"""Read the poses of a hand-eye calibration from a folder, in any of three layouts.

    poses.json                      plop's own: {"mount": "wrist" or "fixed", "base_from_gripper": [4x4, ...],
                                    "cam_from_board": [4x4, ...]} or, instead of the latter, "images": [file names]
                                    of a board beside it
    robot_data*.yaml, marker_data*.yaml   handeye_calibration_ros2: "poses" with "rotation" 3x3 and "translation"
    pose_*/data.json                franka-handeye: O_T_EE (16 numbers), T_cam_target_rvec, _tvec

All lengths in metres. The mount is the setting's, else what poses.json or a file `mount` says, else "wrist" (camera
on the gripper). Matrices that are rigid only when read by columns are read so, and it is said. A pose that somebody
else has solved is read by `handeye_finished`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from plop.errors import PlopError
from plop.geometry.calibration.boards import Board, board_pose, find_board, settle_pattern, what_was_tried
from plop.geometry.pose_matrices import is_transposed

MOUNTS = ("wrist", "fixed")


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
    notes: list[str] = field(default_factory=list)
    """What was read otherwise than written."""
    board: Board | None = None
    """The board as it was found, where images were given."""


@dataclass
class _Pairs:
    robot: np.ndarray
    board: np.ndarray
    mount: str | None = None  # as the files say
    missed: list[str] = field(default_factory=list)
    pattern: Board | None = None


def read_handeye(
    folder: Path,
    *,
    board: Board | None = None,
    matrix: np.ndarray | None = None,
    distortion: np.ndarray | None = None,
    mount: str = "auto",
) -> HandEyeData:
    """Read a folder in whichever layout it has.

    Args:
        folder: See above.
        board: The board in the images of poses.json.
        matrix: K of the camera that took them, pixel centres at integers, shape [3, 3] [px].
        distortion: Its distortion, zeros when absent.
        mount: "wrist" or "fixed"; "auto": as the files say.

    Raises:
        PlopError: Nothing of the three layouts is there, a file is damaged, or no image shows the board.
    """
    lens = np.zeros(5) if distortion is None else distortion
    pairs = readable(folder, lambda: _pairs(folder, board, matrix, lens))
    if pairs is None:
        raise PlopError(
            "There are no poses for a hand-eye calibration.",
            where=folder,
            expected="poses.json, or robot_data*.yaml with marker_data*.yaml, or pose_*/data.json, or a "
            "finished pose (easy_handeye's .yaml or .calib, poses.json with world_from_cam)",
            found="none of them",
            fix="See docs/how-to/hand-eye.md for the layouts.",
        )
    notes: list[str] = []
    chosen = choose_mount(folder, pairs.mount, mount, notes)
    robot, seen = (by_rows(poses, what, notes) for poses, what in ((pairs.robot, "robot"), (pairs.board, "board")))
    if pairs.pattern is not None and board is not None and pairs.pattern.legacy != board.legacy:
        notes.append("its ChArUco board has the legacy pattern (OpenCV before 4.6)")
    return HandEyeData(robot, seen, chosen, pairs.missed, notes, pairs.pattern)


def readable(folder: Path, read: Callable[[], Any]) -> Any:
    """Call a reader; say what is damaged where it stumbles over a file."""
    try:
        return read()
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        said = f"no {error} in it" if isinstance(error, KeyError) else f"{type(error).__name__}: {error}"
        raise PlopError(
            "The poses of a hand-eye calibration cannot be read.",
            where=folder,
            expected="complete files as docs/how-to/hand-eye.md shows",
            found=said,
        ) from error


def read_text(path: Path) -> str:
    """Read a text file, with or without a byte-order mark.

    Raises:
        PlopError: It is empty.
    """
    text = path.read_text(encoding="utf-8-sig")
    if not text.strip():
        raise PlopError(
            "A file of a hand-eye calibration is empty.",
            where=path,
            expected="poses",
            found="no text",
            fix="Copy or record it again.",
        )
    return text


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object."""
    facts = json.loads(read_text(path))
    if not isinstance(facts, dict):
        raise ValueError(f"{path.name} holds no object {{...}}")
    return facts


def read_yaml(path: Path) -> Any:
    """Read a YAML file.

    Raises:
        ValueError: It is no YAML.
    """
    import yaml

    try:
        return yaml.safe_load(read_text(path))
    except yaml.YAMLError as error:
        raise ValueError(f"{path.name}: {error}") from error


def choose_mount(folder: Path, said: str | None, setting: str, notes: list[str]) -> str:
    """Decide between "wrist" and "fixed": the setting, else what a file says, else "wrist"."""
    beside = folder / "mount"
    where = folder / "poses.json" if said is not None else beside
    if said is None and beside.is_file():
        said = read_text(beside).strip()
    if said is not None and said not in MOUNTS:
        raise PlopError(
            "The mount of the camera is unknown.", where=where, expected='"wrist" or "fixed"', found=str(said)
        )
    if setting != "auto" and said not in (None, setting):
        notes.append(f'its files say mount "{said}", handeye_mount says "{setting}", which is taken')
    return setting if setting != "auto" else said or "wrist"


def by_rows(poses: np.ndarray, what: str, notes: list[str]) -> np.ndarray:
    """Give 4x4 matrices row by row; transposed ones are turned, which `notes` then say."""
    if len(poses) and np.isfinite(poses).all() and is_transposed(poses):
        notes.append(f"the {what}'s matrices are column-major: transposed")
        return np.swapaxes(poses, 1, 2).copy()
    return poses


def _pairs(folder: Path, board: Board | None, matrix: np.ndarray | None, distortion: np.ndarray) -> _Pairs | None:
    if (folder / "poses.json").is_file():
        return _own(folder, board, matrix, distortion)
    robots, markers = sorted(folder.glob("robot_data*.yaml")), sorted(folder.glob("marker_data*.yaml"))
    if robots and markers:
        return _Pairs(_yaml_poses(robots[0]), _yaml_poses(markers[0]))
    if singles := sorted(folder.glob("pose_*/data.json")):
        robot, target = zip(*(_franka(path) for path in singles), strict=True)
        return _Pairs(np.stack(robot), np.stack(target))
    return None


def matrices(values: Any, key: str) -> np.ndarray:
    """Give numbers as 4x4 matrices, shape [N, 4, 4]."""
    numbers = np.array(values, dtype=np.float64)
    if numbers.size % 16:
        raise ValueError(f"{key} has {numbers.size} numbers, not 16 for each pose")
    return numbers.reshape(-1, 4, 4)


def _own(folder: Path, board: Board | None, matrix: np.ndarray | None, distortion: np.ndarray) -> _Pairs:
    facts = read_json(folder / "poses.json")
    pairs = _Pairs(matrices(facts["base_from_gripper"], "base_from_gripper"), np.zeros((0, 4, 4)), facts.get("mount"))
    if "cam_from_board" in facts:
        pairs.board = matrices(facts["cam_from_board"], "cam_from_board")
        return pairs
    if board is None or matrix is None:
        raise PlopError(
            "Board images need a board and intrinsics.",
            where=folder / "poses.json",
            expected="calibrate.board_* settings, and intrinsics from the recording or board images",
            found="none",
        )
    names = list(facts["images"])
    if len(names) != len(pairs.robot):
        raise PlopError(
            "Robot poses and images do not pair up.",
            where=folder / "poses.json",
            expected="as many of each",
            found=f"{len(pairs.robot)} poses, {len(names)} images",
        )
    images = [_image(folder, name) for name in names]
    pairs.pattern = settle_pattern(images, board)
    pairs.board, kept = _boards_in(folder, images, pairs.pattern, matrix, distortion)
    pairs.robot, pairs.missed = pairs.robot[kept], [name for i, name in enumerate(names) if i not in kept]
    return pairs


def _boards_in(
    folder: Path, images: Sequence[np.ndarray], board: Board, matrix: np.ndarray, distortion: np.ndarray
) -> tuple[np.ndarray, list[int]]:
    found = {i: corners for i, image in enumerate(images) if (corners := find_board(image, board)) is not None}
    if not found:
        raise PlopError(
            "The board is found in no image.",
            where=folder,
            expected=f"a {board.kind} in each image",
            found=f"none in {len(images)}; {what_was_tried(images, board)}",
            fix="Check the calibrate.board_* settings.",
        )
    return np.stack([board_pose(corners, matrix, distortion)[0] for corners in found.values()]), list(found)


def _image(folder: Path, name: str) -> np.ndarray:
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise PlopError(
            "An image lies outside its folder.", where=folder / "poses.json", expected="a plain file name", found=name
        )
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise PlopError("An image cannot be read.", where=folder / name, expected="a whole image file")
    return image


def _yaml_poses(path: Path) -> np.ndarray:
    rows: list[Any] = read_yaml(path)["poses"]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    for pose, row in zip(poses, rows, strict=True):
        pose[:3, :3] = np.reshape(np.array(row["rotation"], np.float64), (3, 3))
        pose[:3, 3] = np.reshape(np.array(row["translation"], np.float64), 3)
    return poses


def _franka(path: Path) -> tuple[np.ndarray, np.ndarray]:
    facts = readable(path, lambda: read_json(path))
    turn = np.array(facts["T_cam_target_rvec"], dtype=np.float64).reshape(3)
    if np.linalg.norm(turn) > 2 * np.pi:
        raise PlopError(
            "A rotation vector is longer than a full turn.",
            where=f"{path}: T_cam_target_rvec",
            expected="radians, at most pi",
            found=f"{np.linalg.norm(turn):.0f}: degrees?",
            fix="Give radians, as OpenCV's solvePnP does.",
        )
    target = np.eye(4)
    target[:3, :3] = cv2.Rodrigues(turn)[0]
    target[:3, 3] = np.array(facts["T_cam_target_tvec"]).reshape(3)
    return matrices(facts["O_T_EE"], "O_T_EE")[0], target
