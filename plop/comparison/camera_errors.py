"""The prediction as each camera would have seen it: errors of depth, colour and outline, camera by camera.

The Gaussians of the first frame move with the predicted points and are rendered through each camera's own model.
The same is done with the measured points: their remaining error is the floor set by fit, tracking and noise; and with
the two baselines of every table: nothing moves (except the tool), and the best rigid motion, an oracle.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plop.artifacts.layouts import Fit
from plop.comparison.error_fields import ErrorField
from plop.comparison.result import CameraRow
from plop.gaussians.splat_ply import read_splat
from plop.geometry.rigid import kabsch, transform_points
from plop.geometry.view import MaskLabel, View
from plop.recordings.recording import Recording
from plop.render.scene import render_scene, tool_above_table
from plop.tracking.motion_interpolation import MotionInterpolation

_ENDS = ("", "_floor", "_persistence", "_rigid")
"""What is rendered: the prediction, the floor and the two baselines."""


class CarriedScene:
    """Object and tool of one episode as Gaussians, moved by tracked points and the tool's pose.

    Args:
        init: Folder with object.ply and tool.ply of `plop fit-init`.
        points: Followed points at the first frame, [M, 3] [m].
        patch: Patch of every point, [M].
    """

    def __init__(self, init: Path, points: np.ndarray, patch: np.ndarray) -> None:
        self._first, self._tool = read_splat(Fit(init).object_splat), read_splat(Fit(init).tool_splat)
        self._motion = MotionInterpolation(points, patch, self._first.means.double().numpy())

    def views(self, recording: Recording, frame: int, points: np.ndarray, cameras: Iterable[str]) -> list[View]:
        """Render the views of a frame with the tracked points at `points` [M, 3] [m]."""
        placed = tool_above_table(self._tool, recording.world_from_tool[frame], recording.table_z_m)
        seen = [recording.camera(name, frame) for name in cameras]
        return render_scene(self._motion.gaussians_at(self._first, points), placed, seen)


def camera_rows(recording_path: Path, init: Path, field: ErrorField, frames: Sequence[int]) -> list[dict[str, Any]]:
    """Compare rendered with measured images.

    Args:
        recording_path: The recording.
        init: Folder of the episode's fit.
        field: Measured and predicted points.
        frames: Frames to render.

    Returns:
        One row per camera and frame: episode, camera, frame, n (pixels that show the object in both), depth_mm and
        colour (mean absolute differences, colour of 1), outline (share of the pixels in either outline that are not
        in both), and the same with `_floor` for the measured points, `_persistence` for those of the first frame and
        `_rigid` for the best motion of these as one body.
    """
    points = field.episode.points
    scene = CarriedScene(init, points[0], field.episode.patch)
    rows = []
    with Recording.open(recording_path) as recording:
        names = recording.camera_names
        for frame in frames:
            body = transform_points(kabsch(points[0], points[frame]), points[0])
            places = {"": field.predicted[frame], "_floor": points[frame], "_persistence": points[0], "_rigid": body}
            views = {end: scene.views(recording, frame, where, names) for end, where in places.items()}
            for k, name in enumerate(names):
                measured = recording.view(name, frame)
                errors = {
                    f"{key}{end}": value
                    for end, seen in views.items()
                    for key, value in image_errors(seen[k], measured).items()
                    if key != "n" or not end
                }
                rows.append({"episode": field.name, "camera": name, "frame": frame, **errors})
    return rows


def image_errors(ours: View, measured: View) -> dict[str, float | None]:
    """Compare the object in two views of one camera; None where no pixel shows it in both."""
    known = measured.mask != MaskLabel.UNKNOWN
    both = ours.object_mask & measured.object_mask
    either = (ours.object_mask | measured.object_mask) & known
    deep = both & (measured.depth_m > 0) & (ours.depth_m > 0)
    colour = np.abs(ours.rgb[both].astype(float) - measured.rgb[both]) / 255
    return {
        "n": int(deep.sum()),
        "depth_mm": 1000 * float(np.abs(ours.depth_m - measured.depth_m)[deep].mean()) if deep.any() else None,
        "colour": float(colour.mean()) if both.any() else None,
        "outline": float(1 - (both & known).sum() / either.sum()) if either.any() else None,
    }


def camera_table(rows: Sequence[dict[str, Any]]) -> tuple[CameraRow, ...]:
    """Average over episodes and frames: one row per camera, n = pixels."""
    table = []
    for name in dict.fromkeys(row["camera"] for row in rows):
        mine = [row for row in rows if row["camera"] == name]
        found: dict[str, float | None] = {}
        for key in (f"{kind}{end}" for kind in ("depth_mm", "colour", "outline") for end in _ENDS):
            known = [r[key] for r in mine if r[key] is not None]
            found[key] = round(float(np.mean(known)), 4) if known else None
        table.append(CameraRow(name, sum(r["n"] for r in mine), len(mine), found))
    return tuple(table)
