"""Camera-to-robot time offset from the tool's outline in the images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.geometry.calibration.time_offset import offset_by_search
from plop.geometry.cameras import Camera
from plop.geometry.pose_track import poses_at
from plop.geometry.rigid import transform_points
from plop.geometry.view import MaskLabel
from plop.recordings.recording import Mesh, Recording
from plop.sensors.silhouette import outline

MAX_FRAMES = 10
"""Frames looked at, those between which the tool moves fastest."""
MIN_CONTRAST = 1.15
"""The outline must fit this much worse one frame away, or the offset counts as unknown."""
OUTLINE_PX = 0.5
"""How well an outline is placed [px]: with the tool's speed in the image, the resolution of the offset."""
CHANCE = 3.0
"""Standard deviations of the count of wrong pixels by which the found offset must fit better than none."""
MIN_TOOL_PX = 20
"""Frames that show less of the tool are left out."""


@dataclass(frozen=True)
class Offset:
    """How far one camera's images lag the robot."""

    offset_ms: float
    """Image time minus robot time [ms]."""
    resolution_ms: float
    """Time in which the tool moves by OUTLINE_PX in the image [ms]; as large as the offset where the outlines without
    it fit as well, but for chance: a blade seen edge-on shows a few dozen pixels."""


def episode_offsets(recording: Recording, max_offset_ms: float) -> dict[str, Offset]:
    """Measure how far the images lag the robot, per camera.

    The tool's mesh is drawn at its interpolated pose and compared with the tool's mask. Pixels of the object
    are left out, since it may hide the tool. The offset is the one at which the outlines differ least.

    Args:
        recording: Open recording.
        max_offset_ms: Largest offset searched [ms].

    Returns:
        The offset of each camera in whose images the tool moves enough to tell.
    """
    time, poses = recording.time_s, recording.world_from_tool
    if len(time) < 4 or not np.isfinite(poses).all():
        return {}
    frames = _moving_frames(time, poses)
    found = {
        name: _camera_offset(recording, name, frames, time, poses, max_offset_ms) for name in recording.camera_names
    }
    return {name: offset for name, offset in found.items() if offset is not None}


def shifted_tool_poses(recording: Recording, offset_ms: float) -> np.ndarray:
    """Give the tool's pose at the instant that each image shows, shape [T, 4, 4].

    Args:
        recording: Open recording.
        offset_ms: Image time minus robot time [ms].
    """
    return poses_at(recording.time_s, recording.world_from_tool, recording.time_s - offset_ms / 1e3)


def _moving_frames(time: np.ndarray, poses: np.ndarray) -> np.ndarray:
    speed = np.linalg.norm(np.gradient(poses[:, :3, 3], time, axis=0), axis=1)
    moving = np.flatnonzero(speed > 0.25 * speed.max()) if speed.max() > 1e-4 else np.zeros(0, int)
    return moving[np.unique(np.linspace(0, len(moving) - 1, MAX_FRAMES).astype(int))] if len(moving) else moving


def _camera_offset(
    recording: Recording, name: str, frames: np.ndarray, time: np.ndarray, poses: np.ndarray, max_offset_ms: float
) -> Offset | None:
    views = []
    for frame in frames:
        view = recording.view(name, int(frame))
        if view.tool_mask.sum() >= MIN_TOOL_PX:
            views.append((float(time[frame]), view))
    if len(views) < 3:
        return None
    mesh = recording.tool_mesh

    counted = sum(int(view.tool_mask.sum()) for _, view in views)

    def wrong_pixels(offset_s: float) -> int:
        wrong = 0
        at = poses_at(time, poses, np.array([t - offset_s for t, _ in views]))
        for (_, view), pose in zip(views, at, strict=True):
            drawn = outline(mesh, pose, view.camera)
            judged = (view.mask != MaskLabel.OBJECT) & (view.mask != MaskLabel.UNKNOWN)
            wrong += int(((drawn != view.tool_mask) & judged).sum())
        return wrong

    def cost(offset_s: float) -> float:
        return (wrong_pixels(offset_s) + 1) / counted

    step = float(np.median(np.diff(time)))
    found = offset_by_search(cost, max_offset_s=max_offset_ms / 1e3, step_s=step)
    if found is None or found[1] < MIN_CONTRAST:
        return None
    resolution_s = OUTLINE_PX / max(_image_speed(mesh, views[0][1].camera, time, poses), 1e-6)
    if not _fits_better(wrong_pixels(found[0]), wrong_pixels(0.0)):
        resolution_s = max(resolution_s, abs(found[0]))
    return Offset(1e3 * found[0], 1e3 * resolution_s)


def _fits_better(wrong: int, wrong_without: int) -> bool:
    """Tell whether a count of wrong pixels is smaller by more than such counts scatter."""
    return wrong_without - wrong > CHANCE * (wrong_without + wrong) ** 0.5


def _image_speed(mesh: Mesh, camera: Camera, time: np.ndarray, poses: np.ndarray) -> float:
    """Mean speed of the tool's centre in the image [px/s]."""
    centers = np.stack([transform_points(pose, mesh.vertices.mean(0)) for pose in poses])
    pixels, _ = camera.project(centers)
    return float(np.linalg.norm(np.diff(pixels, axis=0), axis=1).sum() / (time[-1] - time[0]))
