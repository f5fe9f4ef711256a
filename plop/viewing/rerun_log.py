"""Send recordings, splats and trajectories to Rerun (optional package rerun-sdk)."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps

from plop.comparison.error_fields import rms_seen
from plop.comparison.field_file import read_field
from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat
from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import Trajectory
from plop.geometry.clouds.cloud_ply import read_cloud
from plop.installed import install_extra
from plop.recordings.recording import Recording
from plop.reporting.colours import ERROR_MAP

SH_0 = 0.28209479177387814
"""The constant spherical harmonic: colour = 0.5 + SH_0 * sh[0]."""
_POINT_M = 0.001


def open_rerun(title: str, save: Path | None) -> Any:
    """Import Rerun and open its viewer, or a file.

    Raises:
        PlopError: It is not installed.
    """
    try:
        rr = importlib.import_module("rerun")
    except ImportError as error:
        fix = f"{install_extra('view')}; or use the PLY and MP4 files of `plop export`."
        raise PlopError("The viewer is not installed.", expected="the package rerun-sdk", fix=fix) from error
    rr.init(title, spawn=save is None)
    if save is not None:
        rr.save(str(save))
    rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    return rr


def log_recording(rr: Any, path: Path) -> None:
    """Log all cameras of a recording, frame by frame, and the tool."""
    with Recording(path) as recording:
        mesh = recording.tool_mesh
        rr.log("world/tool", rr.Mesh3D(vertex_positions=mesh.vertices, triangle_indices=mesh.faces), static=True)
        for frame, (time_s, pose) in enumerate(zip(recording.time_s, recording.world_from_tool, strict=True)):
            rr.set_time("time", duration=float(time_s))
            rr.log("world/tool", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
            for name in recording.camera_names:
                view = recording.view(name, frame)
                camera, entity = view.camera, f"world/{name}"
                pose = np.asarray(camera.world_from_cam)
                rr.log(entity, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
                size = {"width": camera.width, "height": camera.height}
                rr.log(entity, rr.Pinhole(image_from_camera=camera.intrinsics, **size))
                rr.log(f"{entity}/rgb", rr.Image(view.rgb))
                rr.log(f"{entity}/depth", rr.DepthImage(view.depth_m, meter=1.0))


def log_splat(rr: Any, path: Path, entity: str) -> None:
    """Log a splat file."""
    _log_gaussians(rr, read_splat(path), entity, static=True)


def log_trajectory(rr: Any, path: Path) -> None:
    """Log every group of a trajectory, frame by frame."""
    with Trajectory(path) as trajectory:
        for group in trajectory.groups:
            for frame in trajectory.frames(group):
                rr.set_time("frame", sequence=int(frame))
                _log_gaussians(rr, trajectory.read(group, frame), f"world/{group}", static=False)


def log_field(rr: Any, path: Path) -> None:
    """Log an error field of `plop compare`: measured and predicted points coloured by error, and arrows between."""
    field = read_field(path)
    top = max(float(np.quantile(field.error_m, 0.98)), 1e-6)
    colours = (255 * np.asarray(colormaps[ERROR_MAP](np.clip(field.error_m / top, 0, 1)))).astype(np.uint8)
    for frame, time_s in enumerate(field.times_s):
        rr.set_time("time", duration=float(time_s))
        measured, predicted = field.points_m[frame], field.predicted_m[frame]
        rr.log("world/measured", rr.Points3D(measured, colors=colours[frame], radii=_POINT_M))
        rr.log("world/predicted", rr.Points3D(predicted, colors=[200, 200, 200], radii=0.6 * _POINT_M))
        rr.log("world/error", rr.Arrows3D(origins=measured, vectors=predicted - measured, colors=colours[frame]))
        rr.log("error_mm", rr.Scalars(1000 * float(rms_seen(field.error_m, field.seen)[frame])))


def log_cloud(rr: Any, path: Path) -> None:
    """Log a point cloud with colours."""
    cloud = read_cloud(path)
    rr.log("world/cloud", rr.Points3D(cloud.points, colors=cloud.colors), static=True)


def _log_gaussians(rr: Any, gaussians: Gaussians, entity: str, *, static: bool) -> None:
    colors = (0.5 + SH_0 * gaussians.sh[:, 0]).clamp(0, 1).numpy()
    radii = gaussians.scales.mean(dim=1).numpy()
    rr.log(entity, rr.Points3D(gaussians.means.numpy(), colors=colors, radii=radii), static=static)
