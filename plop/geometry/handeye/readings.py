"""Other interpretations of hand-eye poses: the poses if one convention had been written or read differently.

Each interpretation undoes one possible mistake. Whether one of them makes an inconsistent set consistent is decided
in `plop.geometry.handeye.judge`, not here.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from plop.geometry.rigid import invert_rigid

OTHER_MOUNT = {"wrist": "fixed", "fixed": "wrist"}
MOUNTED = {"wrist": "on the gripper", "fixed": "fixed, with the board in the gripper"}
ANGLES = {
    "xyz": "Euler angles x, y, z about fixed axes",
    "XYZ": "Euler angles x, y, z about rotating axes",
    "zyx": "Euler angles z, y, x about fixed axes",
    "ZYX": "Euler angles z, y, x about rotating axes",
    "rotvec": "a rotation vector",
}
"""Rotations given by three numbers, by scipy's names."""
MAX_LEFT_OUT = 60
"""Largest set that is tried with one pair left out: in larger ones a bad pair hardly changes the solution."""

Poses = np.ndarray


@dataclass(frozen=True)
class Reading:
    """The poses under the named assumption."""

    name: str
    """The assumption, e.g. "the robot poses are inverted (gripper_from_base)"."""
    robot: Poses
    """base_from_gripper, shape [M, 4, 4] [m]."""
    board: Poses
    """cam_from_board, shape [M, 4, 4] [m]."""
    mount: str


def other_readings(robot: Poses, board: Poses, mount: str) -> Iterator[Reading]:
    """Yield all other interpretations of a set, the more common mistakes first.

    Args:
        robot: base_from_gripper as given, shape [N, 4, 4] [m].
        board: cam_from_board as given, shape [N, 4, 4] [m].
        mount: "wrist" or "fixed".
    """
    other = OTHER_MOUNT[mount]
    yield Reading("the robot poses are inverted (gripper_from_base)", invert_rigid(robot), board, mount)
    yield Reading(
        f'the camera is mounted differently (mount "{other}": {MOUNTED[other]}; --handeye-mount {other})',
        robot,
        board,
        other,
    )
    yield Reading("the board poses are inverted (board_from_cam)", robot, invert_rigid(board), mount)
    yield Reading("robot and board poses are both inverted", invert_rigid(robot), invert_rigid(board), mount)
    yield Reading(
        f'the board poses are inverted (board_from_cam) and the mount is "{other}"', robot, invert_rigid(board), other
    )
    yield from _pairings(robot, board, mount)
    turns = [Rotation.from_matrix(poses[:, :3, :3]) for poses in (robot, board)]
    for name, changes in _rotations():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # gimbal lock: that interpretation will not fit
            changed = [[change(turn) for change in changes] for turn in turns]
        for first in range(len(changes)):
            yield Reading(f"the robot's {name}", _with(robot, _picked(changed[0], turns[1], first)), board, mount)
            yield Reading(f"the board's {name}", robot, _with(board, _picked(changed[1], turns[0], first)), mount)
        if len(changes) == 1:
            yield Reading(
                f"the robot's and the board's {name}", _with(robot, changed[0][0]), _with(board, changed[1][0]), mount
            )
    if 6 <= len(robot) <= MAX_LEFT_OUT:
        for index in range(len(robot)):
            kept = np.arange(len(robot)) != index
            yield Reading(f"pair {index} (counted from 0) does not belong to the set", robot[kept], board[kept], mount)


def _pairings(robot: Poses, board: Poses, mount: str) -> Iterator[Reading]:
    count = len(robot)
    for start in (0, 1):
        as_text = sorted(range(count), key=lambda i: str(i + start))
        if as_text != list(range(count)):
            order, numbers = np.array(as_text), f"{start}, {start + 1}, {start + 10}, ..."
            name = f"pairs are sorted as text ({numbers}) on one side and by number on the other: the"
            yield Reading(f"{name} robot's are by number", robot[order], board, mount)
            yield Reading(f"{name} board's are by number", robot, board[order], mount)
    for step in (1, 2):
        if count - step >= 4:
            name = f"pose{'s' if step > 1 else ''} of the"
            yield Reading(
                f"the pairing is off by {step} (the first {name} robot has no partner)",
                robot[step:],
                board[:-step],
                mount,
            )
            yield Reading(
                f"the pairing is off by {step} (the first {name} board has no partner)",
                robot[:-step],
                board[step:],
                mount,
            )
    yield Reading("one side is in reversed order", robot[::-1], board, mount)


Change = Callable[[Rotation], Rotation]


def _rotations() -> Iterator[tuple[str, list[Change]]]:
    """Yield the ways to mistake rotations, and how to undo each: two ways where a rotation has two representations."""
    yield "rotations are transposed (3x3 parts column by column)", [lambda turns: turns.inv()]
    yield (
        "quaternions are w, x, y, z and were read as x, y, z, w",
        [lambda turns: Rotation.from_quat(turns.as_quat()[:, [1, 2, 3, 0]])],
    )
    yield (
        "quaternions are x, y, z, w and were read as w, x, y, z",
        [lambda turns: Rotation.from_quat(turns.as_quat()[:, [3, 0, 1, 2]])],
    )
    for read, description in ANGLES.items():
        for meant, wanted in ANGLES.items():
            if meant != read:
                yield (
                    f"angles are {wanted} and were read as {description}",
                    [_reread(read, meant, other) for other in (False, True)],
                )
        yield f"angles ({description}) are radians and were read as degrees", [_reread(read, read, False, 180 / np.pi)]


def _reread(read: str, meant: str, other: bool, factor: float = 1.0) -> Change:
    """Undo one interpretation of three numbers and apply another; `other`: use the second representation."""

    def change(turns: Rotation) -> Rotation:
        if read == "rotvec":
            numbers = turns.as_rotvec()
            length = np.linalg.norm(numbers, axis=1, keepdims=True)
            numbers = numbers * (1 - 2 * np.pi / np.maximum(length, 1e-9)) if other else numbers
        else:
            numbers = turns.as_euler(read)
            numbers = numbers * [1, -1, 1] + np.pi if other else numbers
            numbers = (numbers + np.pi) % (2 * np.pi) - np.pi
        numbers = numbers * factor
        return Rotation.from_rotvec(numbers) if meant == "rotvec" else Rotation.from_euler(meant, numbers)

    return change


def _picked(ways: list[Rotation], across: Rotation, first: int) -> Rotation:
    """Choose for each pose the variant whose rotation from the first pose matches the other side."""
    if len(ways) == 1:
        return ways[0]
    start, wanted = ways[first][0], (across[0].inv() * across).magnitude()
    off = np.stack([np.abs((start.inv() * way).magnitude() - wanted) for way in ways])
    off[1 - first, 0] = np.inf
    better = (off[1] < off[0])[:, None]
    return Rotation.from_quat(np.where(better, ways[1].as_quat(), ways[0].as_quat()))


def _with(poses: Poses, turns: Rotation) -> Poses:
    out = poses.copy()
    out[:, :3, :3] = turns.as_matrix()
    return out
