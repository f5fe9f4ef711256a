"""Clock offset: the camera's time stamps are not on the robot's clock."""

from __future__ import annotations

from plop.parameters import Parameter
from plop.sensors.faults.fault import Fault


class ClockOffset(Fault):
    """A constant lag: an image stamped t shows the scene as it was at t - offset_s."""

    name = "clock"
    help = "the camera's clock is late or early"
    law = "t_scene = t_stamp - offset_s"
    source = "Furgale, Rehder, Siegwart, Unified temporal and spatial calibration, IROS 2013, eq. 2"
    parameters = (Parameter("offset_s", "s", -0.5, 0.5, step=1e-3, help="image time minus robot time"),)

    def true_time(self, time_s: float) -> float:
        """See Fault."""
        return time_s - self["offset_s"]
