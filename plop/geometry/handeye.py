"""Hand-eye and robot-world calibration (OpenCV), the method chosen by consistency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.geometry.rigid import check_rigid, invert_rigid

HAND_EYE_METHODS = {
    "TSAI": cv2.CALIB_HAND_EYE_TSAI,
    "PARK": cv2.CALIB_HAND_EYE_PARK,
    "HORAUD": cv2.CALIB_HAND_EYE_HORAUD,
    "ANDREFF": cv2.CALIB_HAND_EYE_ANDREFF,
    "DANIILIDIS": cv2.CALIB_HAND_EYE_DANIILIDIS,
}
ROBOT_WORLD_METHODS = {
    "SHAH": cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH,
    "LI": cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI,
}
MIN_POSES = 4
MAX_REACH_M = 20.0
"""No robot or board is farther away: larger numbers are another unit [m]."""
MIN_TURN_DEG = 5.0
"""Some two motions must turn at least this far, about axes at least this far apart [deg]."""


@dataclass(frozen=True)
class MethodScore:
    """How well one method's answer keeps the board in place."""

    method: str
    result: np.ndarray
    """[4, 4] [m]; NaN when the method failed"""
    spread_mm: float
    """Mean distance of the board's position from its mean over all poses [mm]."""
    spread_deg: float
    """Mean angle of the board's orientation from its mean [deg]."""
    score: float
    """spread_mm, plus spread_deg turned into mm at the board's mean distance from the camera."""


@dataclass(frozen=True)
class HandEye:
    """The chosen answer and what all methods gave."""

    method: str
    result: np.ndarray
    """Wrist camera: gripper_from_cam. Fixed camera: base_from_cam. Shape [4, 4] [m]."""
    scores: list[MethodScore]
    """Best first."""


def hand_eye(base_from_gripper: np.ndarray, cam_from_board: np.ndarray, *, mount: str = "wrist",
             methods: Sequence[str] = tuple(HAND_EYE_METHODS)) -> HandEye:  # fmt: skip
    """Calibrate a camera against the robot: solve AX = XB with several methods, keep the most consistent.

    A right answer puts the board, seen from every pose, at one place: in the robot's base for a wrist camera,
    in the gripper for a fixed camera with the board in the gripper. The method with the least spread wins.

    Args:
        base_from_gripper: Robot poses, shape [N, 4, 4] [m].
        cam_from_board: Board poses at the same instants, shape [N, 4, 4] [m].
        mount: "wrist" (camera on the gripper) or "fixed" (board on the gripper).
        methods: Names out of HAND_EYE_METHODS.

    Raises:
        PlopError: Too few poses, mismatched lengths, NaN, millimetres, motion without enough rotation, or every
            method fails.
    """
    base_from_gripper, cam_from_board = check_pose_pairs(base_from_gripper, cam_from_board)
    moving = base_from_gripper if mount == "wrist" else invert_rigid(base_from_gripper)
    scores = []
    for name in methods:
        try:
            rotation, translation = cv2.calibrateHandEye(
                list(moving[:, :3, :3]), list(moving[:, :3, 3]), list(cam_from_board[:, :3, :3]),
                list(cam_from_board[:, :3, 3]),
                method=HAND_EYE_METHODS[name])  # fmt: skip
            answer = _pose(rotation, translation)
        except cv2.error:
            answer = np.full((4, 4), np.nan)
        scores.append(score(name, answer, moving, cam_from_board))
    return _best(scores)


def robot_world(base_from_gripper: np.ndarray, cam_from_board: np.ndarray) -> HandEye:
    """Calibrate a wrist camera and the board's place together: AX = ZB (OpenCV's robot-world/hand-eye).

    Args:
        base_from_gripper: Robot poses, shape [N, 4, 4] [m].
        cam_from_board: Board poses at the same instants, shape [N, 4, 4] [m].

    Returns:
        gripper_from_cam by the more consistent of Shah's and Li's methods.

    Raises:
        PlopError: As `hand_eye`.
    """
    base_from_gripper, cam_from_board = check_pose_pairs(base_from_gripper, cam_from_board)
    gripper_from_base = invert_rigid(base_from_gripper)
    scores = []
    for name, method in ROBOT_WORLD_METHODS.items():
        try:
            _, _, rotation, translation = cv2.calibrateRobotWorldHandEye(
                list(cam_from_board[:, :3, :3]), list(cam_from_board[:, :3, 3]), list(gripper_from_base[:, :3, :3]),
                list(gripper_from_base[:, :3, 3]), method=method)  # fmt: skip
            answer = invert_rigid(_pose(rotation, translation))
        except cv2.error:
            answer = np.full((4, 4), np.nan)
        scores.append(score(name, answer, base_from_gripper, cam_from_board))
    return _best(scores)


def score(method: str, answer: np.ndarray, moving: np.ndarray, cam_from_board: np.ndarray) -> MethodScore:
    """Measure how much the board seems to move under one answer.

    Args:
        method: Name to report.
        answer: Camera pose in the moving frame, shape [4, 4] [m].
        moving: Poses of the moving frame, shape [N, 4, 4] [m].
        cam_from_board: Shape [N, 4, 4] [m].
    """
    if not np.isfinite(answer).all() or abs(np.linalg.det(answer[:3, :3]) - 1) > 1e-2:
        return MethodScore(method, np.full((4, 4), np.nan), float("inf"), float("inf"), float("inf"))
    board = moving @ answer @ cam_from_board
    spread = float(np.linalg.norm(board[:, :3, 3] - board[:, :3, 3].mean(0), axis=1).mean() * 1e3)
    turns = Rotation.from_matrix(board[:, :3, :3])
    angle = float(np.rad2deg((turns.mean().inv() * turns).magnitude().mean()))
    reach_mm = float(np.linalg.norm(cam_from_board[:, :3, 3], axis=1).mean() * 1e3)
    return MethodScore(method, answer, spread, angle, spread + np.deg2rad(angle) * reach_mm)


def difference(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Compare two rigid transforms: angle [deg] and distance of their translations [mm]."""
    turn = Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude()
    return float(np.rad2deg(turn)), float(np.linalg.norm(a[:3, 3] - b[:3, 3]) * 1e3)


def check_pose_pairs(base_from_gripper: np.ndarray, cam_from_board: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both as float64 arrays, or raise a PlopError that says why they cannot be used."""
    robot, board = np.asarray(base_from_gripper, np.float64), np.asarray(cam_from_board, np.float64)
    if len(robot) != len(board):
        raise PlopError("Robot poses and board poses do not pair up.", expected="as many of each",
                        found=f"{len(robot)} robot poses, {len(board)} board poses")  # fmt: skip
    if len(robot) < MIN_POSES:
        raise PlopError("There are too few poses for a hand-eye calibration.", expected=f"at least {MIN_POSES}",
                        found=f"{len(robot)}", fix="Record 10 to 20 poses that turn about different axes.")  # fmt: skip
    for what, poses in (("robot", robot), ("board", board)):
        if not np.isfinite(poses).all():
            bad = int(np.flatnonzero(~np.isfinite(poses).all((1, 2)))[0])
            raise PlopError(f"A {what} pose has values that are no numbers.", where=f"pose {bad}",
                            expected="16 finite numbers", found="NaN or infinity",
                            fix="Leave this pair out on both sides.")  # fmt: skip
        check_rigid(poses, "hand-eye poses", what=what)
        if np.abs(poses[:, :3, 3]).max() > MAX_REACH_M:
            raise PlopError(f"The {what} poses seem to be in millimetres (or centimetres).", expected="metres",
                            found=f"a translation of {np.abs(poses[:, :3, 3]).max():.0f}",
                            fix="Divide the translations by 1000 (centimetres: by 100).")  # fmt: skip
    for what, poses in (("robot", robot), ("board", board)):
        _check_turning(what, poses[:, :3, :3])
    return robot, board


def _check_turning(what: str, rotations: np.ndarray) -> None:
    turns = Rotation.from_matrix(rotations)
    pairs = [(turns[i].inv() * turns[j]).as_rotvec() for i in range(len(turns)) for j in range(i)]
    vectors = np.stack(pairs)
    angles = np.rad2deg(np.linalg.norm(vectors, axis=1))
    strong = vectors[angles > MIN_TURN_DEG]
    fix = "Record poses that turn at least 20 degrees about at least two different axes."
    if len(strong) == 0:
        raise PlopError(f"The {what} hardly turns: hand-eye calibration is impossible.",
                        expected=f"rotations above {MIN_TURN_DEG:.0f} deg between poses",
                        found=f"at most {angles.max():.2f} deg (a pure translation)", fix=fix)  # fmt: skip
    axes = strong / np.linalg.norm(strong, axis=1, keepdims=True)
    apart = np.rad2deg(np.arcsin(np.clip(np.linalg.norm(np.cross(axes, axes[0]), axis=1), 0, 1))).max()
    if apart < MIN_TURN_DEG:
        raise PlopError(f"The {what} turns about one axis only: hand-eye calibration is not determined.",
                        expected=f"axes at least {MIN_TURN_DEG:.0f} deg apart", found=f"{apart:.2f} deg",
                        fix=fix)  # fmt: skip


def _pose(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, np.asarray(translation).reshape(3)
    return pose


def _best(scores: list[MethodScore]) -> HandEye:
    ranked = sorted(scores, key=lambda each: each.score)
    if not np.isfinite(ranked[0].score):
        raise PlopError("No hand-eye method found an answer.", expected="consistent robot and board poses",
                        found=", ".join(each.method for each in scores) + " failed")  # fmt: skip
    return HandEye(ranked[0].method, ranked[0].result, ranked)
