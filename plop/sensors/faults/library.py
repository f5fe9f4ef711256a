"""The library of sensor faults, and all faults of an episode, of its cameras and its tool, as one object."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence

import numpy as np

from plop.errors import PlopError
from plop.sensors.faults.clock_offset import ClockOffset
from plop.sensors.faults.depth_bias import DepthBias
from plop.sensors.faults.depth_scale import DepthScale
from plop.sensors.faults.fault import Fault
from plop.sensors.faults.pose_drift import PoseDrift
from plop.sensors.faults.pose_error import PoseError
from plop.sensors.faults.tool import TOOL_FAULTS, Tool, ToolFault

FAULTS: dict[str, type[Fault]] = {
    fault.name: fault for fault in (ClockOffset, PoseError, PoseDrift, DepthScale, DepthBias)
}
"""Those of a camera by name; depth takes the scale first, then the bias."""
ALL_FAULTS: dict[str, type[Fault]] = {**FAULTS, **TOOL_FAULTS}
"""Those of a camera, then those of the tool."""
FIRST_CAMERA = "cam_00"
"""Name of the first camera of a simulated rig."""
TOOL = "tool"
"""Stands for a camera where all of them share the fault."""


class Faults:
    """What is wrong with the cameras and the tool of one episode.

    Args:
        by_camera: The faults of each camera; a camera that is not named has none.
        tool: Those of the tool.
    """

    def __init__(self, by_camera: Mapping[str, Sequence[Fault]], tool: Sequence[ToolFault] = ()) -> None:
        order = list(FAULTS)
        self.by_camera = {
            camera: tuple(sorted(faults, key=lambda fault: order.index(fault.name)))
            for camera, faults in by_camera.items()
            if faults
        }
        self.tool = tuple(tool)

    def __bool__(self) -> bool:
        return bool(self.by_camera or self.tool)

    def of(self, camera: str) -> tuple[Fault, ...]:
        """Give the faults of one camera."""
        return self.by_camera.get(camera, ())

    def true_time(self, camera: str, time_s: float) -> float:
        """Give the scene's time that an image of this camera, stamped `time_s`, shows [s]."""
        for fault in self.of(camera):
            time_s = fault.true_time(time_s)
        return time_s

    def true_pose(self, camera: str, frame_share: float, world_from_cam: np.ndarray) -> np.ndarray:
        """Give the camera's true pose [4, 4] where `world_from_cam` [4, 4] is recorded.

        Args:
            camera: Its name.
            frame_share: 0 at the first frame, 1 at the last: `frame_share(frame, frames)`.
            world_from_cam: Recorded (nominal) pose.
        """
        for fault in self.of(camera):
            world_from_cam = fault.true_pose(frame_share, world_from_cam)
        return world_from_cam

    def depth(self, camera: str, depth_m: np.ndarray) -> np.ndarray:
        """Give what this camera records for true depth, shape [H, W] [m]; 0 (not measured) stays 0."""
        for fault in self.of(camera):
            depth_m = fault.depth(depth_m)
        return depth_m

    def true_depth(self, camera: str, depth_m: np.ndarray) -> np.ndarray:
        """Give the true depth where this camera recorded `depth_m`, shape [H, W] [m]; 0 stays 0."""
        for fault in reversed(self.of(camera)):
            depth_m = fault.true_depth(depth_m)
        return depth_m

    def true_tool(self, recorded: Tool) -> Tool:
        """Give the tool as it is, from what the robot says."""
        for fault in reversed(self.tool):
            recorded = fault.true_tool(recorded)
        return recorded

    def recorded_tool(self, true: Tool) -> Tool:
        """Give what the robot says of a tool."""
        for fault in self.tool:
            true = fault.recorded_tool(true)
        return true

    def as_dict(self) -> dict[str, dict[str, dict[str, float]]]:
        """Give camera, or "tool" -> fault -> parameter -> value, for JSON."""
        places = {**self.by_camera, **({TOOL: self.tool} if self.tool else {})}
        return {place: {f.name: dict(f.values) for f in faults} for place, faults in places.items()}


def frame_share(frame: int, frames: int) -> float:
    """Give the share of the episode that has passed at a frame: 0 at the first, 1 at the last."""
    return frame / max(frames - 1, 1)


def parse_faults(texts: Sequence[str], cameras: Sequence[str] = ()) -> Faults:
    """Read faults as a user types them: `name[.parameter]=value[@camera]`.

    Without a parameter the fault's first is meant, without a camera the first camera; `@*` means all. A fault of the
    tool has no camera. Several parameters of one fault of one camera add up to one fault:
    `pose_drift.x_m=0.003 pose_drift.rz_rad=0.01`.

    Args:
        texts: E.g. ["clock=0.02", "depth_scale=1.01@cam_01"].
        cameras: Names of the cameras, the first one first; without them names are not checked, the first is
            taken to be FIRST_CAMERA, and `@*` is refused.

    Raises:
        PlopError: A text cannot be read, or names an unknown fault, parameter or camera, or a value out of range.
    """
    values: dict[tuple[str, str], dict[str, float]] = {}
    for text in texts:
        kind, parameter, value, wanted = _parse(text)
        for camera in _cameras(text, kind, wanted, cameras):
            given = values.setdefault((camera, kind.name), {})
            if parameter in given:
                raise PlopError(
                    "A sensor fault is given twice.",
                    where=text,
                    expected="each parameter once a camera",
                    found=f"{kind.name}.{parameter} of {camera} again",
                    fix="Leave one of them out.",
                )
            given[parameter] = value
    by_camera: dict[str, list[Fault]] = {}
    for (camera, name), given in values.items():
        if name in FAULTS:
            by_camera.setdefault(camera, []).append(FAULTS[name](**given))
    return Faults(by_camera, [TOOL_FAULTS[name](**given) for (_, name), given in values.items() if name in TOOL_FAULTS])


def _parse(text: str) -> tuple[type[Fault], str, float, str]:
    left, equals, right = text.partition("=")
    name, _, parameter = left.strip().partition(".")
    number, _, camera = right.partition("@")
    if name not in ALL_FAULTS:
        near = difflib.get_close_matches(name, ALL_FAULTS, n=1)
        raise PlopError(
            "There is no such sensor fault.",
            where=text,
            expected=", ".join(ALL_FAULTS),
            found=name,
            fix=f"Did you mean {near[0]}?" if near else "Choose one of these.",
        )
    first = ALL_FAULTS[name].parameters[0]
    try:
        value = float(number)
    except ValueError:
        value = None
    if not equals or value is None:
        raise PlopError(
            "A sensor fault cannot be read.",
            where=text,
            expected="name[.parameter]=number[@camera]",
            found=f"{number!r} as the number",
            fix=f"For example {name}={first.default + 10 * first.step:g}",
        )
    return ALL_FAULTS[name], parameter or first.name, value, camera.strip()


def _cameras(text: str, kind: type[Fault], wanted: str, cameras: Sequence[str]) -> list[str]:
    if issubclass(kind, ToolFault):
        if wanted:
            raise PlopError(
                "A fault of the tool has no camera.",
                where=text,
                expected=f"{kind.name}.PARAMETER=VALUE",
                found=f"@{wanted}",
                fix="Leave the camera out.",
            )
        return [TOOL]
    if wanted == "*" and cameras:
        return list(cameras)
    if not wanted:
        return [cameras[0] if cameras else FIRST_CAMERA]
    if (cameras and wanted not in cameras) or wanted == "*":
        raise PlopError(
            "A sensor fault names a camera that does not exist.",
            where=text,
            expected=", ".join(cameras) or "the name of one camera",
            found=wanted,
            fix="Write name=value@CAMERA with one of these, or no @ for the first.",
        )
    return [wanted]
