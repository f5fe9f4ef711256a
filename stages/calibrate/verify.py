"""Measure how well the cameras of one episode agree in depth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import median_low

import numpy as np

from plop.geometry.calibration.depth_agreement import DepthView, Disagreement, disagreement, object_box, pixels_in_box
from plop.geometry.clouds.pointcloud import check_metres
from plop.geometry.view import View
from plop.recordings.recording import Recording

MIN_COMPARED = 20
"""Pixels that two cameras must share before their difference counts."""


@dataclass(frozen=True)
class CameraCheck:
    """What one camera's depth says against the other cameras'."""

    pixels: int
    """Measured pixels in the region around the object, over the frames checked."""
    disagreement_mm: float | None
    """Lower median over other cameras of the median absolute depth difference [mm]: one of two is enough to agree with,
    so that of three cameras the two that are right stand by each other; None when nothing overlaps."""
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
        out.append(DepthView(view.camera, depth, region))
    return out


def check_episode(
    recording: Recording,
    frames: list[int],
    margin_m: float,
    change: Change | None = None,
    leave_out: frozenset[str] = frozenset(),
) -> dict[str, CameraCheck]:
    """Compare every pair of cameras on some frames: around the object, and on the object alone.

    A shift along the table does not show on the table, so the worse of the two counts.

    Args:
        recording: Open recording.
        frames: Frames to look at.
        margin_m: How far around the object surfaces take part [m].
        change: Trial correction per camera.
        leave_out: Cameras that are known to be wrong: nothing is compared with them.

    Returns:
        One check per camera.
    """
    names = recording.camera_names
    pixels = dict.fromkeys(names, 0)
    kinds: list[dict[str, dict[str, list[Disagreement]]]] = [{name: {} for name in names} for _ in range(2)]
    for frame in frames:
        views = [view for view in read_views(recording, frame, change) if view.camera.name not in leave_out]
        picks = depth_views(views, margin_m)
        objects = [replace(pick, region=view.object_mask) for pick, view in zip(picks, views, strict=True)]
        for pick in picks:
            pixels[pick.camera.name] += int(pick.region.sum())
        for found, these in zip(kinds, (picks, objects), strict=True):
            for a in these:
                for b in these:
                    if a is not b:
                        found[a.camera.name].setdefault(b.camera.name, []).append(disagreement(a, b))
    around, alone = ({name: _summarise(pixels[name], name, found) for name in names} for found in kinds)
    return {name: max(around[name], alone[name], key=lambda check: check.disagreement_mm or 0.0) for name in names}


def _summarise(pixels: int, name: str, found: dict[str, dict[str, list[Disagreement]]]) -> CameraCheck:
    medians, biases, ratios = [], [], []
    for other, pairs in found[name].items():
        there = [pair for pair in pairs if pair.compared >= MIN_COMPARED]
        back = [pair for pair in found[other].get(name, []) if pair.compared >= MIN_COMPARED]
        ratios += [pair.ratio for pair in pairs if np.isfinite(pair.ratio)]
        if there or back:
            medians.append(float(np.median([pair.median_mm for pair in there + back])))
            biases.append(float(np.median([p.bias_mm for p in there] + [-p.bias_mm for p in back])))
    if not medians:
        return CameraCheck(pixels, None, None, float(np.median(ratios)) if ratios else None, 0)
    ratio = float(np.median(ratios)) if ratios else None
    return CameraCheck(pixels, median_low(medians), float(np.median(biases)), ratio, len(medians))


def spread_frames(total: int, count: int) -> list[int]:
    """Pick frames evenly, the first one always: indices, ascending."""
    return sorted({int(i) for i in np.linspace(0, total - 1, max(1, min(count, total)))})
