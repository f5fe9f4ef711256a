"""Check hand-eye poses before their solution is used: consistency, scale, and sufficient motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from plop.geometry.handeye.fit import HandEyeFit, fit_hand_eye
from plop.geometry.handeye.judgement import RULE, HandEyeFault, Judgement
from plop.geometry.handeye.pairs import check_pose_pairs
from plop.geometry.handeye.readings import other_readings
from plop.geometry.rigid import invert_rigid


def judge_hand_eye(base_from_gripper: np.ndarray, cam_from_board: np.ndarray, mount: str) -> Judgement:
    """Check whether pairs of poses give an acceptable solution, and if not, what would explain them.

    Args:
        base_from_gripper: Shape [N, 4, 4] [m].
        cam_from_board: Shape [N, 4, 4] [m].
        mount: "wrist" or "fixed".

    Raises:
        PlopError: The poses cannot be used at all (see `check_pose_pairs`).
    """
    robot, board = check_pose_pairs(base_from_gripper, cam_from_board)
    moving = moving_poses(robot, mount)
    limits = _limits(moving, board)
    fit, scaled = fit_hand_eye(moving, board), fit_hand_eye(moving, board, free_scale=True)
    places = _places(fit, mount)
    fault = _fault(fit, scaled, (*limits, _open_limit(board)), places)
    if fault not in (HandEyeFault.INCONSISTENT, HandEyeFault.ROLES):
        return Judgement(fault, fit, scaled, *limits, _open_limit(board), *places)
    given = None if fault is HandEyeFault.ROLES else fit
    likely, unlikely = consistent_readings(robot, board, mount, given)
    if given is None:  # the given one is consistent, too: only plausible positions discriminate
        unlikely = ()
    elif not likely + unlikely and _consistent(fit, _noise_limits(board)):
        fault = HandEyeFault.UNDETERMINED  # within the noise limit, but a third of the robot's motion
    return Judgement(
        fault,
        fit,
        scaled,
        *limits,
        _open_limit(board),
        *places,
        likely,
        unlikely,
        _different_turns(robot, board, limits[1]),
    )


def moving_poses(robot: np.ndarray, mount: str) -> np.ndarray:
    """Return the poses of the moving frame: gripper in base, or base in gripper."""
    return robot if mount == "wrist" else invert_rigid(robot)


def consistent_readings(
    robot: np.ndarray, board: np.ndarray, mount: str, given: HandEyeFit | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """List other interpretations that are clearly more consistent than the given one; plausible ones, implausible ones.

    Args:
        robot: base_from_gripper, shape [N, 4, 4] [m].
        board: cam_from_board, shape [N, 4, 4] [m].
        mount: "wrist" or "fixed".
        given: The fit of the poses as given; None where they are consistent.
    """
    values: dict[str, float] = {}
    likely: dict[str, bool] = {}
    for reading in other_readings(robot, board, mount):
        moving = moving_poses(reading.robot, reading.mount)
        if not (np.isfinite(moving).all() and np.isfinite(reading.board).all()):
            continue
        limits = _limits(moving, reading.board)
        if not _consistent(fit_hand_eye(moving, reading.board, steps=1), tuple(5 * each for each in limits)):
            continue  # the closed form of a correct interpretation is close already
        fit = fit_hand_eye(moving, reading.board)
        if _consistent(fit, limits) and fit.uncertainty_mm <= _open_limit(reading.board):
            value = _value(fit, reading.board)
            if value < values.get(reading.name, np.inf):
                values[reading.name] = value
                on_gripper, at_base = _places(fit, reading.mount)
                likely[reading.name] = on_gripper < at_base and bool((reading.board[:, 2, 3] > 0).all())
    least = min(values.values(), default=0.0)
    if given is not None and least * RULE.clearly > _value(given, board):
        return (), ()
    named = sorted((n for n in values if values[n] <= max(RULE.clearly * least, 1e-3)), key=values.__getitem__)
    return tuple(n for n in named if likely[n]), tuple(n for n in named if not likely[n])


def _places(fit: HandEyeFit, mount: str) -> tuple[float, float]:
    """Return the distances of the part on the gripper and of the fixed part [m]."""
    ends = [float(np.linalg.norm(pose[:3, 3])) for pose in (fit.moving_from_cam, fit.fixed_from_board)]
    return (ends[0], ends[1]) if mount == "wrist" else (ends[1], ends[0])


def _fault(
    fit: HandEyeFit, scaled: HandEyeFit, limits: tuple[float, float, float], places: tuple[float, float]
) -> HandEyeFault:
    low, high = scaled.scale_interval
    off = low > 1 + RULE.scale_tolerance or high < 1 - RULE.scale_tolerance
    if off and scaled.scale > 0 and _consistent(scaled, limits):
        return HandEyeFault.SCALE
    if not _consistent(fit, limits):
        return HandEyeFault.INCONSISTENT
    if fit.uncertainty_mm > limits[2]:
        return HandEyeFault.UNDETERMINED
    on_gripper, at_base = places
    return HandEyeFault.ROLES if on_gripper > max(RULE.longest_on_gripper_m, 2 * at_base) else HandEyeFault.NONE


def _consistent(fit: HandEyeFit, limits: Sequence[float]) -> bool:
    return fit.spread_mm <= limits[0] and fit.spread_deg <= limits[1]


def _noise_limits(board: np.ndarray) -> tuple[float, float]:
    """Return the error of cameras and robots, independent of the motion [mm, deg]."""
    distance = float(np.linalg.norm(board[:, :3, 3], axis=1).mean() * 1e3)
    return max(RULE.max_spread_of_distance * distance, RULE.least_limit_mm), RULE.max_spread_deg


def _open_limit(board: np.ndarray) -> float:
    distance = float(np.linalg.norm(board[:, :3, 3], axis=1).mean() * 1e3)
    return max(RULE.max_uncertainty_mm, RULE.max_uncertainty_of_distance * distance)


def _limits(moving: np.ndarray, board: np.ndarray) -> tuple[float, float]:
    motion = max(np.linalg.norm(p[:, :3, 3] - p[:, :3, 3].mean(0), axis=1).mean() for p in (moving, board)) * 1e3
    turns = [Rotation.from_matrix(poses[:, :3, :3]) for poses in (moving, board)]
    turned = np.rad2deg(max((each.mean().inv() * each).magnitude().mean() for each in turns))
    noise = _noise_limits(board)
    return float(min(noise[0], RULE.max_of_motion * motion)), float(min(noise[1], RULE.max_of_motion * turned))


def _value(fit: HandEyeFit, board: np.ndarray) -> float:
    return fit.spread_mm + float(np.deg2rad(fit.spread_deg) * np.linalg.norm(board[:, :3, 3], axis=1).mean() * 1e3)


def _different_turns(robot: np.ndarray, board: np.ndarray, limit_deg: float) -> tuple[float, float] | None:
    """Compare rotations between the same two poses: they are independent of frames, so only wrong rotations differ."""
    first, second = np.triu_indices(len(robot), 1)
    a, b = (
        np.rad2deg((r[first].inv() * r[second]).magnitude())
        for r in (Rotation.from_matrix(poses[:, :3, :3]) for poses in (robot, board))
    )
    if np.sqrt(np.mean((a - b) ** 2)) <= 2 * limit_deg:
        return None
    worst = int(np.argmax(np.abs(a - b)))
    return float(a[worst]), float(b[worst])
