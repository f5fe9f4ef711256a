"""Hand-eye and robot-world calibration (OpenCV), the method chosen by consistency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.geometry.handeye.judge import judge_hand_eye, moving_poses
from plop.geometry.handeye.judgement import HandEyeFault
from plop.geometry.handeye.pairs import check_pose_pairs
from plop.geometry.rigid import invert_rigid

HAND_EYE_METHODS = {
    "TSAI": cv2.CALIB_HAND_EYE_TSAI,
    "PARK": cv2.CALIB_HAND_EYE_PARK,
    "HORAUD": cv2.CALIB_HAND_EYE_HORAUD,
    "ANDREFF": cv2.CALIB_HAND_EYE_ANDREFF,
    "DANIILIDIS": cv2.CALIB_HAND_EYE_DANIILIDIS,
}
ROBOT_WORLD_METHODS = {"SHAH": cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH, "LI": cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI}


@dataclass(frozen=True)
class MethodScore:
    """Spread of the board under one method's solution."""

    method: str
    result: np.ndarray
    """[4, 4] [m]; NaN when the method failed"""
    spread_mm: float
    """Mean distance of the board's position from its mean over all poses [mm]."""
    spread_deg: float
    """Mean angle of the board's orientation from its mean [deg]."""
    score: float
    """spread_mm, plus spread_deg converted to mm at the board's mean distance from the camera."""


@dataclass(frozen=True)
class HandEye:
    """The chosen solution and those of all methods."""

    method: str
    result: np.ndarray
    """Wrist camera: gripper_from_cam. Fixed camera: base_from_cam. Shape [4, 4] [m]."""
    scores: list[MethodScore]
    """Best first."""


def hand_eye(
    base_from_gripper: np.ndarray,
    cam_from_board: np.ndarray,
    *,
    mount: str = "wrist",
    methods: Sequence[str] = tuple(HAND_EYE_METHODS),
    judged: bool = False,
) -> HandEye:
    """Calibrate a camera against the robot: solve AX = XB with several methods, keep the most consistent.

    A correct solution gives the board one position for all poses: in the robot's base for a wrist camera,
    in the gripper for a fixed camera with the board in the gripper. The method with the least spread wins.

    Args:
        base_from_gripper: Robot poses, shape [N, 4, 4] [m].
        cam_from_board: Board poses at the same instants, shape [N, 4, 4] [m].
        mount: "wrist" (camera on the gripper) or "fixed" (board on the gripper).
        methods: Names out of HAND_EYE_METHODS.
        judged: Whether the caller has checked the poses (`judge_hand_eye`) and wants a solution in any case.

    Raises:
        PlopError: Too few poses, mismatched lengths, NaN, millimetres, no rigid matrices, motion without enough
            rotation, poses that are inconsistent or do not determine the solution, or every method fails.
    """
    base_from_gripper, cam_from_board = check_pose_pairs(base_from_gripper, cam_from_board)
    if not judged:
        _refuse_bad(base_from_gripper, cam_from_board, mount)
    moving = moving_poses(base_from_gripper, mount)
    scores = []
    for name in methods:
        try:
            rotation, translation = cv2.calibrateHandEye(
                list(moving[:, :3, :3]),
                list(moving[:, :3, 3]),
                list(cam_from_board[:, :3, :3]),
                list(cam_from_board[:, :3, 3]),
                method=HAND_EYE_METHODS[name],
            )
            answer = _pose(rotation, translation)
        except cv2.error:
            answer = np.full((4, 4), np.nan)
        scores.append(score(name, answer, moving, cam_from_board))
    return _best(scores)


def robot_world(base_from_gripper: np.ndarray, cam_from_board: np.ndarray) -> HandEye:
    """Calibrate a wrist camera and the board's pose jointly: AX = ZB (OpenCV's robot-world/hand-eye).

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
                list(cam_from_board[:, :3, :3]),
                list(cam_from_board[:, :3, 3]),
                list(gripper_from_base[:, :3, :3]),
                list(gripper_from_base[:, :3, 3]),
                method=method,
            )
            answer = invert_rigid(_pose(rotation, translation))
        except cv2.error:
            answer = np.full((4, 4), np.nan)
        scores.append(score(name, answer, base_from_gripper, cam_from_board))
    return _best(scores)


def score(method: str, answer: np.ndarray, moving: np.ndarray, cam_from_board: np.ndarray) -> MethodScore:
    """Measure how much the board moves under one solution.

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


def _refuse_bad(robot: np.ndarray, board: np.ndarray, mount: str) -> None:
    judgement = judge_hand_eye(robot, board, mount)
    if judgement.fault is not HandEyeFault.NONE:
        raise PlopError(
            "The hand-eye poses give no acceptable solution.",
            found=judgement.why(),
            expected="a board whose position is the same for every pose",
            fix="Correct the poses as described above, or record them again.",
        )


def _pose(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, np.asarray(translation).reshape(3)
    return pose


def _best(scores: list[MethodScore]) -> HandEye:
    ranked = sorted(scores, key=lambda each: each.score)
    if not np.isfinite(ranked[0].score):
        raise PlopError(
            "No hand-eye method found a solution.",
            expected="consistent robot and board poses",
            found=", ".join(each.method for each in scores) + " failed",
        )
    return HandEye(ranked[0].method, ranked[0].result, ranked)
