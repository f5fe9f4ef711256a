"""Can a recording be calibrated at all: is its tool within reach, and did the cameras see anything?"""

from __future__ import annotations

import numpy as np

from plop.errors import PlopError
from plop.geometry.meshes.tool_checks import check_tool_reach
from plop.geometry.view import View
from plop.recordings.recording import Recording
from stages.calibrate.verify import read_views


def check_recording(recording: Recording, frames: list[int]) -> None:
    """Refuse a recording that later stages could make nothing of.

    Args:
        recording: Open recording.
        frames: Frames on which cameras are compared, the first one first.

    Raises:
        PlopError: The tool has no mesh or is out of reach, no camera sees the object at the first frame or none
            measured depth, or depth is no metres (see read_views).
    """
    poses_at = f"{recording.path}:/tool/world_from_tool"
    poses, mesh = recording.world_from_tool, recording.tool_mesh
    views = read_views(recording, frames[0])
    _check_seen(recording, views, frames)
    clouds = [view.camera.back_project(view.depth_m, view.object_mask) for view in views]
    eyes = np.stack([view.camera.world_from_cam[:3, 3] for view in views])
    check_tool_reach(mesh.vertices, poses, np.concatenate([*clouds, eyes]), poses_at)


def _check_seen(recording: Recording, views: list[View], frames: list[int]) -> None:
    names = ", ".join(recording.camera_names)
    if not any(view.object_mask.any() for view in views):
        raise PlopError(
            "No camera sees the object at the first frame.",
            where=f"{recording.path}:/cameras/*/mask[0]",
            expected="a mask with pixels of the object (1)",
            found=f"none in {names}",
            fix="Check the masks (`plop view`) and ingest again.",
        )
    later = (view for frame in frames[1:] for view in read_views(recording, frame))
    if not any((view.depth_m > 0).any() for views_of in (views, later) for view in views_of):
        raise PlopError(
            "No camera measured any depth.",
            where=f"{recording.path}:/cameras/*/depth_m",
            expected="metres along the optical axis in one camera or more",
            found=f"only 0 or NaN in {names}, frames {', '.join(map(str, frames))}",
            fix="Check the depth in the raw data and ingest again.",
        )
