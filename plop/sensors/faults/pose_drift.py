"""Pose drift: the camera creeps away from its recorded pose in the course of an episode."""

from __future__ import annotations

import numpy as np

from plop.sensors.faults.fault import Fault
from plop.sensors.faults.pose_error import POSE_PARAMETERS, moved_pose


class PoseDrift(Fault):
    """A rigid motion that grows linearly: nothing at the first frame, all of it at the last."""

    name = "pose_drift"
    help = "the camera creeps away from its recorded pose"
    law = "T_true = T_recorded exp(share (x, y, z, rx, ry, rz)), share 0 at the first frame, 1 at the last"
    source = "Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, ch. 2"
    parameters = POSE_PARAMETERS

    def true_pose(self, frame_share: float, world_from_cam: np.ndarray) -> np.ndarray:
        """See Fault."""
        return moved_pose(world_from_cam, frame_share * np.array(list(self.values.values())))
