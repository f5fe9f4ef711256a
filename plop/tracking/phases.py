"""The phases of a motion, from the tool's path and its contact.

approach   before the first contact
contact    contact with any other motion: a press, a push
cut        a blade moves within its own plane, not upwards
hold       contact at rest
retract    it moves up, or has left the object
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from plop.geometry.meshes.tool import ToolGeometry
from plop.tracking.episode import Episode

PHASES = ("approach", "contact", "cut", "hold", "retract")
"""Names of the phases; files store their indices in this list."""
TOUCH_M = 0.001
"""Largest distance of a contact [m]."""
_TOOL_POINTS, _FEW_TOOL_POINTS = 6000, 600
"""Points on the tool's surface: for distances in tables and pictures, and where only the order of phases matters."""
_REST_SHARE = 0.08
"""A tool rests below this share of its largest speed."""
_UP_SHARE = 0.5
"""A tool moves up when at least this share of its velocity is upward."""
_THIN = 0.3
"""A blade is thinner than this share of its next larger extent."""


@dataclass(frozen=True)
class ToolView:
    """Contact between tool and object; T frames, M tracked points."""

    distance_m: np.ndarray
    """Distance of every tracked point to the tool's surface, [T, M] [m]."""
    touches: np.ndarray
    """Whether the tool touches the object, bool [T]."""
    phase: np.ndarray
    """Index in PHASES, int [T]."""


def view_tool(episode: Episode, tool_points: int = _TOOL_POINTS) -> ToolView:
    """Measure distances to the tool, and determine the phases of an episode.

    Args:
        episode: The episode.
        tool_points: Points on the tool's surface that distances are measured to.
    """
    geometry = ToolGeometry.from_mesh(episode.tool.vertices, episode.tool.faces)
    surface = np.concatenate([geometry.surface_points(tool_points).double().numpy(), episode.tool.vertices])
    nearest, planes = cKDTree(surface), _planes(episode.vertices)
    distance, gap = [], []
    for pose, points in zip(episode.tool.world_from_tool, episode.points, strict=True):
        distance.append(nearest.query((points - pose[:3, 3]) @ pose[:3, :3])[0])
        above = planes[:, :3] @ pose[:3, 3] + planes[:, 3]
        gap.append(float((surface @ (planes[:, :3] @ pose[:3, :3]).T + above).max(1).min()))
    away = np.stack(distance)
    touches = _touches(np.array(gap), away.min(1), _spacing(episode.points[0]))
    return ToolView(away, touches, _phases(episode, geometry, touches))


def _planes(vertices: np.ndarray) -> np.ndarray:
    """Planes of the convex hull, each once, [P, 4]: outward unit normals and offsets [m]."""
    equations = ConvexHull(vertices).equations
    return np.asarray(equations[np.unique(equations.round(9), axis=0, return_index=True)[1]])


def _spacing(points: np.ndarray) -> float:
    """Median distance between neighbouring tracked points [m]."""
    return float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))


def _touches(gap: np.ndarray, nearest: np.ndarray, spacing: float) -> np.ndarray:
    """Return the frames in which the tool touches.

    A contact starts where the tool reaches the object's surface of the first frame, which is known everywhere;
    it lasts while a tracked point is close, since the surface between them is not tracked.
    """
    found = np.zeros(len(gap), bool)
    for frame in range(len(gap)):
        reaches = gap[frame] < TOUCH_M
        stays = frame > 0 and found[frame - 1] and nearest[frame] < TOUCH_M + 0.5 * spacing
        found[frame] = reaches or stays
    return found


def _phases(episode: Episode, geometry: ToolGeometry, touches: np.ndarray) -> np.ndarray:
    velocity = _velocity(episode)
    speed = np.linalg.norm(velocity, axis=1)
    moves = speed > _REST_SHARE * max(float(speed.max()), 1e-9)
    up = velocity[:, 2] > _UP_SHARE * np.maximum(speed, 1e-12)
    normal = episode.tool.world_from_tool[:, :3, :3] @ geometry.axes[:, 0].double().numpy()
    across = np.abs((velocity * normal).sum(1)) > _UP_SHARE * np.maximum(speed, 1e-12)
    half = geometry.half_extent.double().numpy()
    blade = half[0] < _THIN * half[1]
    first = int(np.argmax(touches)) if touches.any() else len(touches)
    phase = np.full(len(touches), PHASES.index("contact"))
    phase[~moves] = PHASES.index("hold")
    if blade:
        phase[moves & ~across & ~up] = PHASES.index("cut")
    phase[(moves & up) | ~touches] = PHASES.index("retract")
    phase[:first] = PHASES.index("approach")
    return phase


def _velocity(episode: Episode) -> np.ndarray:
    """Mean velocity of the tool's corners towards each frame, [T, 3] [m/s]; the first frame has the second's."""
    middle = episode.tool.vertices.mean(0)
    poses = episode.tool.world_from_tool
    place = poses[:, :3, :3] @ middle + poses[:, :3, 3]
    step = np.diff(place, axis=0) / np.diff(episode.times)[:, None]
    return np.concatenate([step[:1], step])


def motion_kind(episode: Episode) -> str:
    """Name the kind of an episode's motion by the sequence of its phases, e.g. "press hold press".

    A contact is a press where the tool moves mostly downwards, else a push; phases of a single frame are ignored,
    as is everything before the first contact and after the last one.
    """
    phase, velocity = view_tool(episode, _FEW_TOOL_POINTS).phase, _velocity(episode)
    words = []
    for first, last, name in spans(phase):
        if last == first or name == "approach":
            continue
        mean = velocity[first : last + 1].mean(0)
        if name == "contact":
            name = "press" if -mean[2] > _UP_SHARE * float(np.linalg.norm(mean)) else "push"
        words.append(name)
    while words and words[-1] == "retract":
        words.pop()
    return " ".join(words)


def spans(phase: np.ndarray) -> Iterator[tuple[int, int, str]]:
    """Yield the runs of equal phase as (first frame, last frame, name)."""
    edges = np.flatnonzero(np.diff(phase)) + 1
    for run in np.split(np.arange(len(phase)), edges):
        yield int(run[0]), int(run[-1]), PHASES[int(phase[run[0]])]
