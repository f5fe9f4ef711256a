"""What one camera of a recording says about itself: the frames that are looked at and the object's place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.geometry.pose_track import poses_at
from plop.geometry.rigid import transform_points
from plop.geometry.view import View
from plop.lazy_open3d import o3d
from plop.recordings.recording import Mesh, Recording

MAX_FRAMES = 26
"""At most this many frames are looked at, evenly spread."""


@dataclass(frozen=True)
class ToolTrack:
    """The recorded tool: its mesh, its poses, and a ray caster in its own frame."""

    mesh: Mesh
    time_s: np.ndarray
    """[T]"""
    poses: np.ndarray
    """[T, 4, 4]"""
    caster: o3d.t.geometry.RaycastingScene

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """Poses at some times [N] [s], shape [N, 4, 4]."""
        return poses_at(self.time_s, self.poses, times_s) if len(self.time_s) > 1 else self.poses[[0] * len(times_s)]

    @property
    def speed_m_s(self) -> float:
        """Speed of the tool's middle where it moves: root mean square over time [m/s]."""
        if len(self.time_s) < 2:
            return 0.0
        middle = np.stack([transform_points(pose, self.mesh.vertices.mean(0)) for pose in self.poses])
        step, seconds = np.diff(middle, axis=0), np.diff(self.time_s)
        return float(np.sqrt(((step**2).sum(1) / seconds).sum() / seconds.sum()))


@dataclass(frozen=True)
class Sighting:
    """A view, and when it was."""

    time_s: float
    """On the robot's clock [s]."""
    share: float
    """Share of the episode that has passed, 0 to 1."""
    view: View


@dataclass(frozen=True)
class CameraScene:
    """All that is needed to judge one camera."""

    camera: str
    sightings: list[Sighting]
    tool: ToolTrack | None
    table_z_m: float | None
    middle: np.ndarray
    """Middle of the object in the world, shape [3] [m]; where the camera looks when it sees no object."""
    reach_m: float
    """Half the object's diagonal [m]."""


def tool_track(recording: Recording) -> ToolTrack | None:
    """Read the tool; None when its poses are not known."""
    poses, mesh = recording.world_from_tool, recording.tool_mesh
    if not np.isfinite(poses).all() or not len(mesh.faces):
        return None
    caster = o3d.t.geometry.RaycastingScene(nthreads=1)
    caster.add_triangles(
        o3d.core.Tensor.from_numpy(np.ascontiguousarray(mesh.vertices, np.float32)),
        o3d.core.Tensor.from_numpy(np.ascontiguousarray(mesh.faces, np.uint32)),
    )
    return ToolTrack(mesh, recording.time_s, poses, caster)


def camera_scene(recording: Recording, camera: str, tool: ToolTrack | None) -> CameraScene:
    """Read the frames of one camera, MAX_FRAMES at most."""
    frames = np.unique(np.linspace(0, len(recording) - 1, min(MAX_FRAMES, len(recording))).round().astype(int))
    time = recording.time_s
    last = max(len(time) - 1, 1)
    sightings = [Sighting(float(time[f]), float(f / last), recording.view(camera, int(f))) for f in frames]
    first = sightings[0].view
    points = first.camera.back_project(first.depth_m, first.object_mask)
    if len(points) < 10:
        pose, depth = first.camera.world_from_cam, first.depth_m[first.depth_m > 0]
        distance = float(np.median(depth)) if len(depth) else 0.5
        return CameraScene(camera, sightings, tool, recording.table_z_m, pose[:3, 3] + distance * pose[:3, 2], 0.05)
    low, high = np.percentile(points, [2, 98], axis=0)
    return CameraScene(
        camera, sightings, tool, recording.table_z_m, (low + high) / 2, float(np.linalg.norm(high - low) / 2)
    )
