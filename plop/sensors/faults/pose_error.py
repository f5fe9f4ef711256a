"""Pose error: the camera stands elsewhere than its calibration says."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from plop.parameters import Parameter
from plop.sensors.faults.fault import Fault

POSE_PARAMETERS = (
    *(
        Parameter(f"{axis}_m", "m", -0.1, 0.1, step=1e-3, help=f"shift {where}")
        for axis, where in (("x", "to the image's right"), ("y", "down in the image"), ("z", "along the optical axis"))
    ),
    *(
        Parameter(f"r{axis}_rad", "rad", -0.2, 0.2, step=1e-3, help=f"turn about the camera's {axis} axis")
        for axis in "xyz"
    ),
)
"""A small rigid motion in the camera's own axes (OpenCV), about the camera's centre."""


def moved_pose(world_from_cam: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Move a camera in its own axes.

    Args:
        world_from_cam: Shape [4, 4].
        motion: Shift [m] and rotation vector [rad], shape [6].

    Returns:
        Shape [4, 4].
    """
    step = np.eye(4)
    step[:3, :3] = Rotation.from_rotvec(motion[3:]).as_matrix()
    step[:3, 3] = motion[:3]
    return world_from_cam @ step


class PoseError(Fault):
    """A constant rigid motion between the recorded and the true pose."""

    name = "pose_error"
    help = "the camera stands elsewhere than its calibration says"
    law = "T_true = T_recorded exp(x, y, z, rx, ry, rz)"
    source = "Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, ch. 2"
    parameters = POSE_PARAMETERS

    def true_pose(self, frame_share: float, world_from_cam: np.ndarray) -> np.ndarray:
        """See Fault."""
        return moved_pose(world_from_cam, np.array(list(self.values.values())))
