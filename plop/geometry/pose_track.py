"""Poses between the instants at which they were recorded."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp


def poses_at(time_s: np.ndarray, poses: np.ndarray, wanted_s: np.ndarray) -> np.ndarray:
    """Interpolate rigid poses (linear, slerp); constant before the first and after the last.

    Args:
        time_s: Shape [T], increasing [s].
        poses: Shape [T, 4, 4].
        wanted_s: Shape [N] [s].

    Returns:
        Shape [N, 4, 4].
    """
    at = np.clip(wanted_s, time_s[0], time_s[-1])
    out = np.tile(np.eye(4), (len(at), 1, 1))
    out[:, :3, :3] = Slerp(time_s, Rotation.from_matrix(poses[:, :3, :3]))(at).as_matrix()
    for axis in range(3):
        out[:, axis, 3] = np.interp(at, time_s, poses[:, axis, 3])
    return out
