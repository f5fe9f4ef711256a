"""Hand-eye calibration as one least-squares problem, with its errors and the board's scale.

M_i X C_i = Z for all pairs i: M the pose of what moves (gripper for a wrist camera; base seen from the gripper for a
fixed one), X the camera in it, C the board before the camera, Z the board's constant pose. The start is the closed
form of Park and Martin (1994) for rotations; Gauss-Newton then solves for X, Z and, where asked, a factor s of all
board distances (a board printed in another size), each kind of residual weighted by its own scatter. OpenCV's methods
give a solution without its error; this gives the errors, which show what the motion determines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

STEPS = 8
MOST_TURNS = 300
"""Number of relative rotations, out of all pairs of poses, used for the initial solution."""
CONFIDENCE = 0.999
"""Error probability of the interval of the board's scale: one correct set in a thousand is rejected by chance."""
LEAST_NOISE = 1e-7
"""Floor of the residuals' scatter [m, rad]: exact synthetic poses."""


@dataclass(frozen=True)
class HandEyeFit:
    """A solution with its errors."""

    moving_from_cam: np.ndarray
    """X, shape [4, 4] [m]."""
    fixed_from_board: np.ndarray
    """Z, shape [4, 4] [m]."""
    scale: float
    """Factor of all board distances; 1 where it was not fitted."""
    scale_interval: tuple[float, float]
    """99.9 % interval of the scale; (1, 1) where it was not fitted."""
    spread_mm: float
    """Mean distance of the board's position from its mean, allowing for the unknowns fitted [mm]."""
    spread_deg: float
    """Mean angle of the board's orientation from its mean, allowing for the unknowns fitted [deg]."""
    uncertainty_mm: float
    """Standard error of the position of a point at the board's mean distance [mm]; inf: undetermined."""


def fit_hand_eye(
    moving: np.ndarray, cam_from_board: np.ndarray, *, free_scale: bool = False, steps: int = STEPS
) -> HandEyeFit:
    """Solve M X C = Z.

    Args:
        moving: M, shape [N, 4, 4] [m], N >= 4.
        cam_from_board: C, shape [N, 4, 4] [m].
        free_scale: Whether the board's distances are multiplied by an unknown, too.
        steps: Largest number of Gauss-Newton steps; 1 gives the closed form.
    """
    state = _start(moving, cam_from_board, free_scale)
    best, least = state, np.inf
    for _ in range(steps):
        turn, shift = _residuals(state, moving, cam_from_board)
        cost = np.linalg.norm(shift, axis=1).mean() + np.linalg.norm(turn, axis=1).mean()
        if not np.isfinite(cost) or cost > 10 * least:
            break
        if cost < least:
            best, least = state, cost
        step, _ = _solve(state, moving, cam_from_board, free_scale)
        state = _moved(state, step)
    return _described(best, moving, cam_from_board, free_scale)


@dataclass(frozen=True)
class _State:
    cam_turn: np.ndarray  # rotation of X [3, 3]
    board_turn: np.ndarray  # rotation of Z [3, 3]
    cam_place: np.ndarray  # [3]
    board_place: np.ndarray  # [3]
    scale: float


def _start(moving: np.ndarray, board: np.ndarray, free_scale: bool) -> _State:
    first, second = np.triu_indices(len(moving), 1)
    some = np.linspace(0, len(first) - 1, min(len(first), MOST_TURNS)).astype(int)
    first, second = first[some], second[some]
    robot, seen = Rotation.from_matrix(moving[:, :3, :3]), Rotation.from_matrix(board[:, :3, :3])
    a = (robot[first].inv() * robot[second]).as_rotvec()
    b = (seen[first] * seen[second].inv()).as_rotvec()
    clear = np.linalg.norm(a, axis=1) < np.deg2rad(160)  # near half a turn the sign of the axis is arbitrary
    if clear.sum() < 2:
        clear[:] = True
    left, _, right = np.linalg.svd(b[clear].T @ a[clear])
    cam_turn = right.T @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ left.T
    board_turn = (robot * Rotation.from_matrix(cam_turn) * seen).mean().as_matrix()
    state = _State(cam_turn, board_turn, np.zeros(3), np.zeros(3), 1.0)
    _, shift = _residuals(state, moving, board)
    jacobian = _shift_jacobian(state, moving, board)[:, :, 6:]
    unknowns = 7 if free_scale else 6
    step = np.linalg.lstsq(jacobian[..., :unknowns].reshape(-1, unknowns), -shift.reshape(-1), rcond=None)[0]
    scale = float(np.clip(1 + step[6], 1e-4, 1e4)) if free_scale else 1.0
    return _State(cam_turn, board_turn, step[:3], step[3:6], scale)


def _residuals(state: _State, moving: np.ndarray, board: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    turned = state.board_turn.T @ moving[:, :3, :3] @ state.cam_turn @ board[:, :3, :3]
    point = state.scale * board[:, :3, 3] @ state.cam_turn.T + state.cam_place
    shift = np.einsum("nij,nj->ni", moving[:, :3, :3], point) + moving[:, :3, 3] - state.board_place
    return Rotation.from_matrix(turned).as_rotvec(), shift


def _shift_jacobian(state: _State, moving: np.ndarray, board: np.ndarray) -> np.ndarray:
    """Derivatives by rotation of X, rotation of Z, position of X, position of Z, scale: [N, 3, 13]."""
    out = np.zeros((len(moving), 3, 13))
    turned = moving[:, :3, :3] @ state.cam_turn
    out[:, :, 0:3] = -turned @ _cross(state.scale * board[:, :3, 3])
    out[:, :, 6:9], out[:, :, 9:12] = moving[:, :3, :3], -np.eye(3)
    out[:, :, 12] = np.einsum("nij,nj->ni", turned, board[:, :3, 3])
    return out


def _turn_jacobian(board: np.ndarray) -> np.ndarray:
    out = np.zeros((len(board), 3, 13))
    out[:, :, 0:3], out[:, :, 3:6] = np.swapaxes(board[:, :3, :3], 1, 2), -np.eye(3)
    return out


def _solve(state: _State, moving: np.ndarray, board: np.ndarray, free_scale: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the Gauss-Newton step [12 or 13] and the covariance of the unknowns."""
    unknowns = 13 if free_scale else 12
    turn, shift = _residuals(state, moving, board)
    freedom = max(3 * len(moving) - unknowns / 2, 1)
    sizes = [max(np.sqrt((part**2).sum() / freedom), LEAST_NOISE) for part in (turn, shift)]
    jacobian = np.concatenate(
        [
            _turn_jacobian(board)[..., :unknowns].reshape(-1, unknowns) / sizes[0],
            _shift_jacobian(state, moving, board)[..., :unknowns].reshape(-1, unknowns) / sizes[1],
        ]
    )
    residual = np.concatenate([turn.reshape(-1) / sizes[0], shift.reshape(-1) / sizes[1]])
    covariance = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-14, hermitian=True)
    return -covariance @ (jacobian.T @ residual), covariance


def _moved(state: _State, step: np.ndarray) -> _State:
    turn = Rotation.from_rotvec(np.stack([step[:3], step[3:6]])).as_matrix()
    return _State(
        state.cam_turn @ turn[0],
        state.board_turn @ turn[1],
        state.cam_place + step[6:9],
        state.board_place + step[9:12],
        state.scale + (step[12] if len(step) > 12 else 0.0),
    )


def _described(state: _State, moving: np.ndarray, board: np.ndarray, free_scale: bool) -> HandEyeFit:
    turn, shift = _residuals(state, moving, board)
    _, covariance = _solve(state, moving, board, free_scale)
    unknowns = 13 if free_scale else 12
    allowing = np.sqrt(6 * len(moving) / max(6 * len(moving) - unknowns, 1))
    camera, place = np.eye(4), np.eye(4)
    camera[:3, :3], camera[:3, 3] = state.cam_turn, state.cam_place
    place[:3, :3], place[:3, 3] = state.board_turn, state.board_place
    interval = (1.0, 1.0)
    if free_scale:
        reach = float(student.ppf(0.5 + CONFIDENCE / 2, 6 * len(moving) - 13) * np.sqrt(covariance[12, 12]))
        interval = (float(state.scale - reach), float(state.scale + reach))
    by_turn = -state.cam_turn @ _cross(state.scale * board[:, :3, 3])
    placing = np.concatenate([by_turn, np.tile(np.eye(3), (len(board), 1, 1))], 2)
    part = covariance[np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])]
    variance = np.einsum("nij,jk,nik->n", placing, part, placing).mean()
    return HandEyeFit(
        camera,
        place,
        state.scale,
        interval,
        float(np.linalg.norm(shift, axis=1).mean() * 1e3 * allowing),
        float(np.rad2deg(np.linalg.norm(turn, axis=1).mean()) * allowing),
        float(np.sqrt(max(variance, 0.0)) * 1e3),
    )


def _cross(vectors: np.ndarray) -> np.ndarray:
    x, y, z = vectors.T
    o = np.zeros_like(x)
    return np.stack([o, -z, y, z, o, -x, -y, x, o], -1).reshape(-1, 3, 3)
