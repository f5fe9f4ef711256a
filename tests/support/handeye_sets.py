"""Robot and board poses of rigs drawn at random, right and with one thing wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from plop.geometry.cameras import look_at
from plop.geometry.rigid import invert_rigid, pose_from_euler_xyz


@dataclass(frozen=True)
class Rig:
    """Pairs of poses and the answer."""

    robot: np.ndarray
    board: np.ndarray
    mount: str
    answer: np.ndarray
    """moving_from_cam [4, 4]."""


def draw_rig(
    seed: int,
    *,
    mount: str | None = None,
    pairs: int | None = None,
    noise_mm: float | None = None,
    noise_deg: float | None = None,
    turn_deg: float | None = None,
    size: float = 1.0,
) -> Rig:
    """Draw a rig: 6 to 40 pairs, 0.2 to 3 mm and 0.05 to 0.5 deg of noise per axis, turns of 10 to 50 deg.

    `size` scales all lengths, the noise with them.
    """
    draw = np.random.default_rng(seed)
    drawn_mount = str(draw.choice(["wrist", "fixed"]))
    mount, count = mount or drawn_mount, int(draw.integers(6, 41))
    count = pairs or count
    drawn = [float(np.exp(draw.uniform(*np.log(limits)))) for limits in ((0.2, 3), (0.05, 0.5), (10, 50))]
    given = (noise_mm, noise_deg, turn_deg)
    mm, deg, turn = (own if asked is None else asked for own, asked in zip(drawn, given, strict=True))
    robot = np.tile(np.eye(4), (count, 1, 1))
    turns = Rotation.from_euler("xyz", np.deg2rad(draw.uniform(-turn, turn, (count, 3))))
    robot[:, :3, :3] = (turns * Rotation.from_euler("x", np.pi)).as_matrix()
    robot[:, :3, 3] = size * ([0.5, 0, 0.4] + draw.uniform(-1, 1, (count, 3)) * min(0.2, 0.2 * turn / 30))
    if mount == "wrist":
        answer = pose_from_euler_xyz(
            np.r_[size * draw.uniform(-0.08, 0.08, 3), draw.uniform(-0.3, 0.3, 2), draw.uniform(-3, 3)]
        )
        place = pose_from_euler_xyz(
            np.r_[size * (np.array([0.5, 0, 0]) + draw.uniform(-0.1, 0.1, 3)), 0, 0, draw.uniform(-3, 3)]
        )
        board = invert_rigid(robot @ answer) @ place
    else:
        around = draw.uniform(0, 2 * np.pi)
        eye = size * np.array([0.5 + 0.7 * np.cos(around), 0.7 * np.sin(around), draw.uniform(0.3, 1)])
        answer = look_at(eye, size * np.array([0.5, 0, 0.4]), np.array([0, 0, 1.0]))
        place = pose_from_euler_xyz(np.r_[size * draw.uniform(-0.1, 0.1, 3), draw.uniform(-3, 3, 3)])
        board = invert_rigid(answer) @ robot @ place
    board[:, :3, 3] += size * draw.normal(0, mm / 1e3, (count, 3))
    board[:, :3, :3] @= Rotation.from_rotvec(np.deg2rad(draw.normal(0, deg, (count, 3)))).as_matrix()
    return Rig(robot, board, mount, answer)


def turned(poses: np.ndarray, change) -> np.ndarray:
    """Change the rotations of poses."""
    out = poses.copy()
    out[:, :3, :3] = change(Rotation.from_matrix(poses[:, :3, :3])).as_matrix()
    return out


def stretched(poses: np.ndarray, factor: float) -> np.ndarray:
    """Change the positions of poses."""
    out = poses.copy()
    out[:, :3, 3] *= factor
    return out
