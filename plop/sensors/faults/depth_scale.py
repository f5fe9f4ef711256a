"""Depth scale: the camera's depth is a little too long or too short, in proportion."""

from __future__ import annotations

import numpy as np

from plop.parameters import Parameter
from plop.sensors.faults.fault import Fault


class DepthScale(Fault):
    """A constant factor, e.g. from a wrong stereo baseline or focal length of the depth sensor."""

    name = "depth_scale"
    help = "depth is too long or too short by a factor"
    law = "d_recorded = factor d"
    source = "Herrera, Kannala, Heikkila, Joint depth and color camera calibration, PAMI 2012, sec. 2"
    parameters = (Parameter("factor", "-", 0.5, 2.0, step=1e-3, default=1.0, help="recorded depth over true depth"),)

    def depth(self, depth_m: np.ndarray) -> np.ndarray:
        """See Fault."""
        return np.asarray(depth_m * depth_m.dtype.type(self["factor"]))

    def true_depth(self, depth_m: np.ndarray) -> np.ndarray:
        """See Fault."""
        return np.asarray(depth_m / depth_m.dtype.type(self["factor"]))
