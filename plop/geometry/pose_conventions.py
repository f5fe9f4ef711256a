"""Conventions of camera poses in other programs, to find the one in which a pose was written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from plop.geometry.rigid import invert_rigid

ANGLES = {
    "": "xyz",
    "intrinsic XYZ Euler angles": "XYZ",
    "extrinsic zyx Euler angles, first angle about z": "zyx",
    "intrinsic ZYX Euler angles (yaw, pitch, roll)": "ZYX",
    "a rotation vector": "vector",
    "extrinsic xyz Euler angles in degrees": "degrees",
}
"""Name -> how a, b, c turn; "" is plop's own: extrinsic xyz, radians."""
AXES = {
    "": np.eye(3),
    "OpenGL / Blender camera axes (right, up, backwards)": np.diag([1.0, -1.0, -1.0]),
    "ROS body axes (forward, left, up)": np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
}
"""Name -> written axes from OpenCV's (right, down, forward), shape [3, 3]; "" is plop's own."""
INVERSE = "world -> camera instead of camera -> world"


@dataclass(frozen=True)
class PoseReading:
    """One way to read six numbers."""

    departures: tuple[str, ...]
    """What differs from plop's own convention."""
    world_from_cam: np.ndarray
    """Shape [4, 4], OpenCV axes."""


def readings_of(pose6: np.ndarray) -> Iterator[PoseReading]:
    """Read [x, y, z, a, b, c] in every convention, plop's own first, then those with fewer departures from it.

    Args:
        pose6: As stored, shape [6].
    """
    found = []
    for angles, order in ANGLES.items():
        for axes, turn in AXES.items():
            for inverse in ("", INVERSE):
                pose = np.eye(4)
                pose[:3, :3] = _rotation(pose6[3:], order)
                pose[:3, 3] = pose6[:3]
                if inverse:
                    pose = invert_rigid(pose)
                pose[:3, :3] = pose[:3, :3] @ turn
                found.append(PoseReading(tuple(text for text in (inverse, axes, angles) if text), pose))
    yield from sorted(found, key=lambda reading: len(reading.departures))


def _rotation(angles: np.ndarray, order: str) -> np.ndarray:
    if order == "vector":
        return np.asarray(Rotation.from_rotvec(angles).as_matrix())
    if order == "degrees":
        return np.asarray(Rotation.from_euler("xyz", angles, degrees=True).as_matrix())
    return np.asarray(Rotation.from_euler(order, angles).as_matrix())
