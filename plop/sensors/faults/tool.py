"""Faults that all cameras share: what the robot says of its tool is wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plop.geometry.meshes.thickened import thickened
from plop.geometry.pose_track import poses_at
from plop.parameters import Parameter
from plop.sensors.faults.clock_offset import ClockOffset
from plop.sensors.faults.fault import Fault


@dataclass(frozen=True)
class Tool:
    """The tool in one episode, as it is or as a robot says."""

    time_s: np.ndarray
    """[T]"""
    world_from_tool: np.ndarray
    """[T, 4, 4]"""
    vertices: np.ndarray
    """Of its mesh, in its own frame, [V, 3] [m]."""
    faces: np.ndarray
    """[F, 3]"""


class ToolFault(Fault):
    """Base of the faults of a tool; a subclass overrides `true_tool`."""

    def true_tool(self, recorded: Tool) -> Tool:
        """Give the tool as it is, from what the robot says."""
        return recorded

    def recorded_tool(self, true: Tool) -> Tool:
        """Give what the robot says of a tool: every fault is undone by its negative."""
        return type(self)(**{key: -value for key, value in self.values.items()}).true_tool(true)


class RobotClock(ToolFault):
    """A constant lag of all images behind the robot's poses."""

    name = "robot_clock"
    help = "the clocks of all cameras differ alike from the robot's"
    law = "T_true(t) = T_recorded(t - offset_s)"
    source = ClockOffset.source
    parameters = ClockOffset.parameters

    def true_tool(self, recorded: Tool) -> Tool:
        """See ToolFault."""
        times = recorded.time_s - self["offset_s"]
        return replace(recorded, world_from_tool=poses_at(recorded.time_s, recorded.world_from_tool, times))


class ToolOffset(ToolFault):
    """A constant shift in the hand."""

    name = "tool_offset"
    help = "the tool is elsewhere in the hand than the hand-eye calibration says"
    law = "T_true = T_recorded shift(x, y, z)"
    source = "Tsai, Lenz, A new technique for fully autonomous and efficient 3D robotics hand/eye calibration, 1989"
    parameters = tuple(
        Parameter(f"{axis}_m", "m", -0.1, 0.1, step=1e-3, help=f"true place along the tool's own {axis}")
        for axis in "xyz"
    )

    def true_tool(self, recorded: Tool) -> Tool:
        """See ToolFault."""
        shift = np.eye(4)
        shift[:3, 3] = list(self.values.values())
        return replace(recorded, world_from_tool=recorded.world_from_tool @ shift)


class ToolThickness(ToolFault):
    """A surface that lies outside or inside the mesh's, everywhere by the same distance."""

    name = "tool_thickness"
    help = "the tool is thicker or thinner than its mesh"
    law = "x_true = x_mesh + side_m n"
    source = "offset of a polyhedron: Farouki, The approximation of non-degenerate offset surfaces, CAGD 3, 1986"
    parameters = (
        Parameter("side_m", "m", -0.02, 0.02, step=5e-4, help="true surface outside the mesh's, on each side"),
    )

    def true_tool(self, recorded: Tool) -> Tool:
        """See ToolFault."""
        return replace(recorded, vertices=thickened(recorded.vertices, recorded.faces, self["side_m"]))


TOOL_FAULTS: dict[str, type[ToolFault]] = {fault.name: fault for fault in (RobotClock, ToolOffset, ToolThickness)}
"""All of them by name."""
