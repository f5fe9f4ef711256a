"""Faults that all cameras share: what the robot says of its tool is wrong."""

from __future__ import annotations

from dataclasses import dataclass

from plop.parameters import Parameter
from plop.sensors.faults.clock_offset import ClockOffset


@dataclass(frozen=True)
class ToolFault:
    """One thing that may be wrong with the tool as it was recorded."""

    help: str
    parameters: tuple[Parameter, ...]


TOOL_FAULTS: dict[str, ToolFault] = {
    "robot_clock": ToolFault("the clocks of all cameras differ alike from the robot's", ClockOffset.parameters),
    "tool_offset": ToolFault(
        "the tool is elsewhere in the hand than the hand-eye calibration says",
        tuple(
            Parameter(f"{axis}_m", "m", -0.1, 0.1, step=1e-3, help=f"true place along the tool's own {axis}")
            for axis in "xyz"
        ),
    ),
    "tool_thickness": ToolFault(
        "the tool is thicker or thinner than its mesh",
        (Parameter("side_m", "m", -0.02, 0.02, step=5e-4, help="true surface outside the mesh's, on each side"),),
    ),
}
"""Name -> fault."""
