"""Depth bias: the camera's depth is off by a constant length."""

from __future__ import annotations

import numpy as np

from plop.parameters import Parameter
from plop.sensors.faults.fault import Fault


class DepthBias(Fault):
    """A constant length added to depth along the optical axis."""

    name = "depth_bias"
    help = "depth is off by a constant length"
    law = "d_recorded = d + offset_m"
    source = "Herrera, Kannala, Heikkila, Joint depth and color camera calibration, PAMI 2012, sec. 2"
    parameters = (Parameter("offset_m", "m", -0.1, 0.1, step=1e-3, help="recorded depth minus true depth"),)

    def depth(self, depth_m: np.ndarray) -> np.ndarray:
        """See Fault; depth that would not be positive counts as not measured."""
        return self._add(depth_m, self["offset_m"])

    def true_depth(self, depth_m: np.ndarray) -> np.ndarray:
        """See Fault; likewise."""
        return self._add(depth_m, -self["offset_m"])

    @staticmethod
    def _add(depth_m: np.ndarray, offset_m: float) -> np.ndarray:
        moved = depth_m + depth_m.dtype.type(offset_m)
        return np.asarray(np.where((depth_m > 0) & (moved > 0), moved, depth_m.dtype.type(0)))
