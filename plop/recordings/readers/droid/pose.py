"""Poses as DROID writes them, [x, y, z, a, b, c] in metres and radians: rejects implausible ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from plop.errors import PlopError

FARTHEST_M = 5.0
"""Largest distance of a robot or camera from the robot's base; larger values are taken as millimetres [m]."""


def check_pose(poses: np.ndarray, *, where: str, what: str) -> None:
    """Reject poses whose numbers cannot be metres and radians.

    Args:
        poses: [x, y, z, a, b, c], shape [..., 6]; NaN rows are skipped.
        where: File and key, for the message.
        what: Whose pose it is, for the message.

    Raises:
        PlopError: Positions look like millimetres, or angles like degrees.
    """
    poses = np.atleast_2d(poses)
    poses = poses[np.isfinite(poses).all(-1)]
    if not len(poses):
        return
    distance = float(np.linalg.norm(poses[:, :3], axis=1).max())
    if distance > FARTHEST_M:
        raise PlopError(
            f"The {what}'s position does not seem to be in metres.",
            where=where,
            expected=f"within {FARTHEST_M:g} m of the robot's base",
            found=f"{distance:.1f}",
            fix="Positions must be in metres: divide millimetres by 1000.",
        )
    angle = float(np.abs(poses[:, 3:]).max())
    if angle > 2 * np.pi + 1e-3:
        raise PlopError(
            f"The {what}'s angles do not seem to be in radians.",
            where=where,
            expected="Euler angles xyz in radians",
            found=f"{angle:.1f}",
            fix="Convert degrees to radians.",
        )


def pose_from_json(value: Any, *, where: str, what: str) -> np.ndarray:
    """Read [x, y, z, a, b, c] from a JSON file, shape [6], metres and radians.

    Args:
        value: Content of the file.
        where: File and key, for the message.
        what: Whose pose it is, for the message.

    Raises:
        PlopError: These are not six finite numbers, or not metres and radians.
    """
    try:
        pose = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        pose = np.zeros(0)
    if pose.shape != (6,) or not np.isfinite(pose).all():
        raise PlopError(
            f"The {what}'s pose cannot be read.",
            where=where,
            expected="[x, y, z, a, b, c]: six finite numbers, metres and radians",
            found=str(value)[:120],
            fix="Correct the file.",
        )
    check_pose(pose, where=where, what=what)
    return pose
