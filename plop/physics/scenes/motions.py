"""How a tool moves in one episode: press, hold, retract, cycles, cut, cut-retract, cut-draw, cut-push, push.

A motion is a path of straight segments at constant speed, sampled at the frames: between frames the tool
moves by interpolation of its recorded poses, so that a recording contains the whole motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.errors import PlopError
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.shapes import Shape
from plop.physics.scenes.tools import Mesh, blade_mesh, box_mesh, cylinder_mesh

PRESSES = ("press", "hold", "retract", "cycles")
CUTS = ("cut", "cut-retract", "cut-draw", "cut-push")
MOTIONS = (*PRESSES, *CUTS, "push")
"""press: down and rest. hold: down and a long rest. retract: down, rest, up. cycles: twice down and up.
cut: the blade cuts through. cut-retract: through and up again. cut-draw: through, a long rest, slow withdrawal.
cut-push: through and sideways with one half. push: a block pushes the whole object along the table."""

_GAP_M = 0.004
"""Free distance before contact [m]."""
_BELOW_M = 0.006
"""How far the edge of the blade goes below the table's height [m]."""
_REST_S = 0.12
_SLOWLY = 0.4
"""Speed of a slow withdrawal, as a share of the descent's."""
_PUSHER = 0.4
"""Length of the pushing block along its path, as a share of the object's narrower side."""


@dataclass(frozen=True)
class MotionRanges:
    """Ranges of the uniformly drawn motion of an episode: (least, most)."""

    press_speed_m_s: tuple[float, float] = (0.04, 0.14)
    """Speed of a press, down and up [m/s]."""
    press_depth_m: tuple[float, float] = (0.006, 0.011)
    """How deep the indenter goes into the object [m]."""
    press_offset_m: tuple[float, float] = (-0.008, 0.008)
    """Where the indenter's axis meets the object, along x and along y [m]."""
    hold_s: tuple[float, float] = (0.35, 0.50)
    """Rest of a hold [s]."""
    cut_speed_m_s: tuple[float, float] = (0.08, 0.12)
    """Speed of the blade's descent [m/s]."""
    cut_offset_m: tuple[float, float] = (-0.010, 0.010)
    """Where the cut crosses the object's x axis [m]."""
    yaw_deg: tuple[float, float] = (-15.0, 15.0)
    """Turn of blade and indenter about the vertical [deg]."""
    aside_m: tuple[float, float] = (0.014, 0.022)
    """Distance of a sideways push, of one half or of the whole [m]."""
    aside_speed_m_s: tuple[float, float] = (0.05, 0.11)
    """Speed of a sideways push [m/s]."""

    def __post_init__(self) -> None:
        limits = {
            "press_speed_m_s": (1e-3, 1.0),
            "press_depth_m": (-0.1, 0.1),
            "press_offset_m": (-0.25, 0.25),
            "hold_s": (0.0, 10.0),
            "cut_speed_m_s": (1e-3, 1.0),
            "cut_offset_m": (-0.25, 0.25),
            "yaw_deg": (-60.0, 60.0),
            "aside_m": (0.0, 0.2),
            "aside_speed_m_s": (1e-3, 1.0),
        }
        for name, (low, high) in limits.items():
            pair = getattr(self, name)
            if len(pair) != 2 or not low <= pair[0] <= pair[1] <= high:
                raise PlopError(
                    "A range of the motions is not valid.",
                    where=f"motion.{name}",
                    found=str(pair),
                    expected=f"(least, most) within {low:g} to {high:g}",
                    fix="Check the unit: metres, seconds, degrees.",
                )


@dataclass(frozen=True)
class MotionPlan:
    """The motion of one episode."""

    kind: str
    """One of MOTIONS."""
    tool: str
    """blade, box or cylinder."""
    x_m: float
    """Where the tool meets the object, along x [m]."""
    y_m: float
    """And along y [m]."""
    yaw_rad: float
    """Turn of the tool about the vertical; a push goes along its x axis [rad]."""
    speed_m_s: float
    """Speed of press or descent [m/s]."""
    depth_m: float
    """Depth of a press [m]."""
    hold_s: float
    """Rest of a hold [s]."""
    aside_m: float
    """Distance of a sideways push; its sign chooses the half [m]."""
    aside_speed_m_s: float
    """Speed of a sideways push [m/s]."""


def draw_motion(kind: str, ranges: MotionRanges, generator: np.random.Generator) -> MotionPlan:
    """Draw one episode's motion, with the same number of draws for every kind."""

    def draw(pair: tuple[float, float]) -> float:
        return float(generator.uniform(*pair))

    tool = str(generator.choice(["box", "cylinder"]))
    side, quarter = float(generator.choice([-1, 1])), int(generator.integers(4))
    yaw = float(np.deg2rad(draw(ranges.yaw_deg)))
    offset = (draw(ranges.press_offset_m), draw(ranges.press_offset_m))
    press, cut, where = draw(ranges.press_speed_m_s), draw(ranges.cut_speed_m_s), draw(ranges.cut_offset_m)
    depth, hold = draw(ranges.press_depth_m), draw(ranges.hold_s)
    aside, aside_speed = draw(ranges.aside_m), draw(ranges.aside_speed_m_s)
    if kind in CUTS:
        return MotionPlan(kind, "blade", where, 0.0, yaw, cut, 0.0, hold, side * aside, aside_speed)
    if kind == "push":
        yaw += quarter * np.pi / 2
        return MotionPlan(kind, "box", 0.0, offset[1] / 2, yaw, press, 0.0, hold, aside, aside_speed)
    return MotionPlan(kind, tool, *offset, yaw, press, depth, hold, 0.0, aside_speed)


def tool_motion(plan: MotionPlan, shape: Shape, frame_rate_hz: float) -> ToolMotion:
    """Build the tool and its poses at the frames.

    Args:
        plan: The motion.
        shape: The object.
        frame_rate_hz: Frames per second.
    """
    knots_s, points = _path(plan, shape)
    count = int(np.ceil(knots_s[-1] * frame_rate_hz - 1e-9)) + 1
    times = np.arange(count) / frame_rate_hz
    return ToolMotion(*_tool(plan, shape), times, led_along(knots_s, points, plan.yaw_rad, times))


def led_along(knots_s: np.ndarray, points: np.ndarray, yaw_rad: float, times: np.ndarray) -> np.ndarray:
    """Move a tool along straight segments with a fixed rotation about the vertical.

    Args:
        knots_s: Times of the corners, [K] [s].
        points: Corners of the path, [K, 3] [m].
        yaw_rad: The rotation [rad].
        times: Times of the poses, [T] [s].

    Returns:
        world_from_tool, [T, 4, 4].
    """
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    poses[:, :2, :2] = [[cos, -sin], [sin, cos]]
    poses[:, :3, 3] = np.stack([np.interp(times, knots_s, column) for column in points.T], 1)
    return poses


def _path(plan: MotionPlan, shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the motion: times [K] [s] and points [K, 3] [m]."""
    direction = np.array([np.cos(plan.yaw_rad), np.sin(plan.yaw_rad), 0.0])
    if plan.kind == "push":
        reach = shape.reach_m(direction[:2]) + _GAP_M + _PUSHER * min(shape.size_m[:2]) / 2
        start = plan.y_m * np.array([-direction[1], direction[0], 0]) - reach * direction + [0, 0, 0.003]
        return _timed(start, [(start + (_GAP_M + plan.aside_m) * direction, plan.aside_speed_m_s), 2 * _REST_S])
    over = np.array([plan.x_m, plan.y_m, 0.0])
    above = over + [0, 0, shape.height_m + _GAP_M]
    if plan.kind in CUTS:
        through = over - [0, 0, _BELOW_M]
        legs: dict[str, list[tuple[np.ndarray, float] | float]] = {
            "cut": [2 * _REST_S],
            "cut-retract": [_REST_S, (above, plan.speed_m_s), _REST_S],
            "cut-draw": [plan.hold_s, (above, _SLOWLY * plan.speed_m_s), _REST_S],
            "cut-push": [_REST_S / 2, (through + plan.aside_m * direction, plan.aside_speed_m_s)],
        }
        return _timed(above, [(through, plan.speed_m_s), *legs[plan.kind]])
    down, up = (over + [0, 0, shape.height_m - plan.depth_m], plan.speed_m_s), (above, plan.speed_m_s)
    presses: dict[str, list[tuple[np.ndarray, float] | float]] = {
        "press": [down, 2 * _REST_S],
        "hold": [down, plan.hold_s],
        "retract": [down, _REST_S, up, _REST_S],
        "cycles": [down, _REST_S / 2, up, _REST_S / 2, down, _REST_S / 2, up, _REST_S],
    }
    return _timed(above, presses[plan.kind])


def _timed(start: np.ndarray, legs: list[tuple[np.ndarray, float] | float]) -> tuple[np.ndarray, np.ndarray]:
    """Convert legs, each (target, speed) or a rest in seconds, to corners with times."""
    times, points = [0.0], [start]
    for leg in legs:
        if isinstance(leg, tuple):
            points.append(leg[0])
            times.append(times[-1] + max(float(np.linalg.norm(leg[0] - points[-2])) / leg[1], 1e-3))
        else:
            points.append(points[-1])
            times.append(times[-1] + leg)
    return np.array(times), np.stack(points)


def _tool(plan: MotionPlan, shape: Shape) -> Mesh:
    """Build the tool in proportion to the object."""
    across = min(shape.size_m[:2])
    if plan.tool == "blade":
        return blade_mesh(height_m=max(0.040, shape.height_m), length_m=max(0.150, 2 * max(shape.size_m[:2])))
    if plan.kind == "push":
        return box_mesh((_PUSHER * across, 0.7 * across, 0.7 * shape.height_m))
    if plan.tool == "cylinder":
        return cylinder_mesh(0.28 * across, 0.5 * shape.height_m)
    return box_mesh((0.5 * across, 0.5 * across, 0.5 * shape.height_m))
