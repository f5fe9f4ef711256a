"""What a sensor fault is: one law of the measurement, with parameters that have units and a range.

The scene is right and the camera records it wrongly. A law turns what a camera says into what is true
(`true_time`, `true_pose`, `true_depth`) and what is true into what the camera would record (`depth`); each hook does
nothing unless a fault overrides it.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from plop.parameters import Parameter, checked_values


class Fault:
    """Base of all sensor faults; a subclass sets the class variables and overrides the hooks it needs.

    Args of the constructor are the values of the parameters, by name; what is left out keeps the value that
    means 'absent', the parameter's default.

    Raises:
        PlopError: An unknown parameter, or a value that is out of range or not finite.
    """

    name: ClassVar[str]
    """Short name, as the user types it, e.g. "clock"."""
    help: ClassVar[str]
    """One line: what it is."""
    law: ClassVar[str]
    """The law as a formula in plain text."""
    source: ClassVar[str]
    """Where the law is from."""
    parameters: ClassVar[tuple[Parameter, ...]]
    """Its numbers; the first is meant when none is named."""

    def __init__(self, **values: float) -> None:
        self.values = checked_values(
            "sensor fault", self.name, self.parameters, values, units="seconds, metres, radians"
        )

    def __getitem__(self, parameter: str) -> float:
        """Value of one parameter."""
        return self.values[parameter]

    def __repr__(self) -> str:
        inner = ", ".join(f"{key}={value:g}" for key, value in self.values.items())
        return f"{self.name}({inner})"

    def true_time(self, time_s: float) -> float:
        """Give the scene's time that an image stamped `time_s` shows [s]."""
        return time_s

    def true_pose(self, frame_share: float, world_from_cam: np.ndarray) -> np.ndarray:
        """Give the camera's true pose [4, 4] where `world_from_cam` is recorded.

        Args:
            frame_share: Share of the episode that has passed, 0 at the first frame and 1 at the last.
            world_from_cam: Recorded pose, shape [4, 4].
        """
        return world_from_cam

    def depth(self, depth_m: np.ndarray) -> np.ndarray:
        """Give what the camera records for true depth, any shape [m]; 0 (not measured) stays 0."""
        return depth_m

    def true_depth(self, depth_m: np.ndarray) -> np.ndarray:
        """Give the true depth where the camera recorded `depth_m`, any shape [m]; 0 stays 0."""
        return depth_m
