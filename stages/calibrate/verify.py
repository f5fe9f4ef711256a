"""Measure how well the cameras of one episode agree in depth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from statistics import median_low

import numpy as np

from plop.geometry.calibration.depth_agreement import DepthView, Disagreement, disagreement, object_box, pixels_in_box
from plop.geometry.clouds.pointcloud import check_metres
from plop.geometry.view import View
from plop.recordings.recording import Recording


@dataclass(frozen=True)
class CameraCheck:
    """What one camera's depth says against the other cameras'."""

    pixels: int
    """Measured pixels in the region around the object, over the frames checked."""
    disagreement_mm: float | None
    """Lower median over other cameras of the shown depth difference [mm]: one of two is enough to agree
    with, so that of three cameras the two that are right stand by each other; None when nothing can be compared."""
    bias_mm: float | None
    """Median over other cameras of their depth minus this one's [mm]."""
    ratio: float | None
    """Median over other cameras of their depth divided by this one's."""
    partners: int
    """Cameras that see part of the same surface."""


Change = Mapping[str, tuple[np.ndarray, float]]
"""Per camera: a rigid transform applied to its pose in the world, [4, 4], and a factor for its depth."""


def read_views(recording: Recording, frame: int, change: Change | None = None) -> list[View]:
    """Read one frame of all cameras, with a trial correction applied.

    Args:
        recording: Open recording.
        frame: Index of the frame.
        change: Trial correction per camera; cameras that it lacks stay as they are.

    Returns:
        Views with NaN and infinite depth set to 0 (not measured).

    Raises:
        PlopError: Depth is negative or in millimetres.
    """
    views = []
    for name in recording.camera_names:
        view = recording.view(name, frame)
        check_metres(view.depth_m, f"{recording.path}:/cameras/{name}/depth_m[{frame}]")
        move, factor = (change or {}).get(name, (np.eye(4), 1.0))
        depth = np.nan_to_num(view.depth_m, nan=0.0, posinf=0.0, neginf=0.0) * np.float32(factor)
        camera = replace(view.camera, world_from_cam=move @ view.camera.world_from_cam)
        views.append(replace(view, camera=camera, depth_m=depth))
    return views


def depth_views(views: list[View], margin_m: float) -> list[DepthView]:
    """Choose the pixels to compare: measured, near the object, neither tool nor undecided.

    These hide surfaces from one camera that another sees: they are not looked up either.

    Args:
        views: One frame of all cameras.
        margin_m: How far around the object surfaces take part [m].
    """
    clouds = [view.camera.back_project(view.depth_m, view.object_mask) for view in views]
    box = object_box(clouds, margin_m)
    out = []
    for view in views:
        depth = view.depth_without_tool_m
        region = pixels_in_box(view.camera, depth, box) if box else depth > 0
        out.append(DepthView(view.camera, depth, region, view.object_mask))
    return out


def check_episode(
    recording: Recording,
    frames: list[int],
    margin_m: float,
    change: Change | None = None,
    leave_out: frozenset[str] = frozenset(),
) -> dict[str, CameraCheck]:
    """Compare every pair of cameras on some frames.

    Args:
        recording: Open recording.
        frames: Frames to look at.
        margin_m: How far around the object surfaces take part [m].
        change: Trial correction per camera.
        leave_out: Cameras that are known to be wrong: nothing is compared with them.

    Returns:
        One check per camera.
    """
    names = [name for name in recording.camera_names if name not in leave_out]
    shots = []
    for frame in frames:
        views = [view for view in read_views(recording, frame, change) if view.camera.name in names]
        shots.append(dict(zip(names, depth_views(views, margin_m), strict=True)))
    pairs = {(a, b): disagreement([(shot[a], shot[b]) for shot in shots]) for a, b in combinations(names, 2)}
    pixels = {
        name: sum(int(shot[name].region.sum()) for shot in shots if name in shot) for name in recording.camera_names
    }
    return {name: _summarise(pixels[name], name, pairs) for name in recording.camera_names}


def _summarise(pixels: int, name: str, pairs: Mapping[tuple[str, str], Disagreement]) -> CameraCheck:
    own = [(pair, 1 if names[0] == name else -1) for names, pair in pairs.items() if name in names]
    ratios = [pair.ratio**way for pair, way in own if np.isfinite(pair.ratio)]
    ratio = float(np.median(ratios)) if ratios else None
    told = [(pair, way) for pair, way in own if pair.compared]
    if not told:
        return CameraCheck(pixels, None, None, ratio, 0)
    bias = float(np.nanmedian([way * pair.bias_mm for pair, way in told]))
    return CameraCheck(pixels, median_low([pair.shown_mm for pair, _ in told]), bias, ratio, len(told))


def spread_frames(total: int, count: int) -> list[int]:
    """Pick frames evenly, the first one always: indices, ascending."""
    return sorted({int(i) for i in np.linspace(0, total - 1, max(1, min(count, total)))})
