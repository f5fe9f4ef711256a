"""Reject pairs of robot and board poses that no hand-eye method can use."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.geometry.rigid import check_rigid

MIN_POSES = 4
MAX_REACH_M = 20.0
"""Largest distance of robot and board: larger numbers are in another unit [m]."""
MIN_TURN_DEG = 5.0
"""At least two motions must rotate by this angle, about axes at least this far apart [deg]."""


def check_pose_pairs(base_from_gripper: np.ndarray, cam_from_board: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both as float64 arrays, or raise a PlopError with the reason why they cannot be used."""
    robot, board = np.asarray(base_from_gripper, np.float64), np.asarray(cam_from_board, np.float64)
    if len(robot) != len(board):
        raise PlopError(
            "There are not as many robot poses as board poses.",
            expected="equal numbers of both",
            found=f"{len(robot)} robot poses, {len(board)} board poses",
        )
    if len(robot) < MIN_POSES:
        raise PlopError(
            "There are too few poses for a hand-eye calibration.",
            expected=f"at least {MIN_POSES}",
            found=f"{len(robot)}",
            fix="Record 10 to 20 poses that rotate about different axes.",
        )
    for what, poses in (("robot", robot), ("board", board)):
        if not np.isfinite(poses).all():
            bad = int(np.flatnonzero(~np.isfinite(poses).all((1, 2)))[0])
            raise PlopError(
                f"A {what} pose has values that are not finite.",
                where=f"pose {bad}",
                expected="16 finite numbers",
                found="NaN or infinity",
                fix="Leave this pair out on both sides.",
            )
        if np.abs(poses[:, :3, 3]).max() > MAX_REACH_M:
            raise PlopError(
                f"The {what} poses seem to be in millimetres (or centimetres).",
                expected="metres",
                found=f"a translation of {np.abs(poses[:, :3, 3]).max():.0f}",
                fix="Divide the translations by 1000 (centimetres: by 100).",
            )
        check_rigid(poses, "hand-eye poses", what=what)
    turns = {what: _turns(poses[:, :3, :3]) for what, poses in (("robot", robot), ("board", board))}
    for what, other in (("robot", "board"), ("board", "robot")):
        _check_turning(what, turns[what], other, turns[other])
    return robot, board


def _turns(rotations: np.ndarray) -> np.ndarray:
    """Return the rotations between all pairs of poses as rotation vectors, shape [P, 3] [rad]."""
    turns = Rotation.from_matrix(rotations)
    first, second = np.triu_indices(len(turns), 1)
    return np.asarray((turns[first].inv() * turns[second]).as_rotvec())


def _check_turning(what: str, vectors: np.ndarray, other: str, others: np.ndarray) -> None:
    angles = np.rad2deg(np.linalg.norm(vectors, axis=1))
    most = np.rad2deg(np.linalg.norm(others, axis=1)).max()
    # the same motion rotates both sides by the same angle
    unlike = (
        f", while the {other} rotates by up to {most:.0f} deg: were radians read as degrees?"
        if most > 3 * angles.max()
        else ""
    )
    strong = vectors[angles > MIN_TURN_DEG]
    fix = "Record poses that rotate by at least 20 degrees about at least two different axes."
    if len(strong) == 0:
        raise PlopError(
            f"The {what} hardly rotates: hand-eye calibration is impossible.",
            expected=f"rotations above {MIN_TURN_DEG:.0f} deg between poses",
            found=f"at most {angles.max():.2f} deg (a pure translation){unlike}",
            fix=fix,
        )
    axes = strong / np.linalg.norm(strong, axis=1, keepdims=True)
    apart = np.rad2deg(np.arcsin(np.clip(np.linalg.norm(np.cross(axes, axes[0]), axis=1), 0, 1))).max()
    if apart < MIN_TURN_DEG:
        raise PlopError(
            f"The {what} rotates about one axis only: hand-eye calibration is not determined.",
            expected=f"axes at least {MIN_TURN_DEG:.0f} deg apart",
            found=f"{apart:.2f} deg{unlike}",
            fix=fix,
        )
