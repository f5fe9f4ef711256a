"""Fuse the views of one episode into one object cloud."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from plop.causes import Cause, Noticed
from plop.errors import PlopError, remembering
from plop.geometry.calibration.depth_agreement import DepthView, disagreement
from plop.geometry.clouds.plane import find_plane
from plop.geometry.clouds.pointcloud import (
    PointCloud,
    check_metres,
    cloud_from_depth,
    join,
    largest_clusters,
    outlier_free,
    voxel_average,
)
from plop.geometry.clouds.registration import Registration, register
from plop.geometry.clouds.tsdf import fuse_tsdf
from plop.geometry.view import MaskLabel, View
from plop.recordings.recording import Recording
from stages.fuse.usable_views import check_table, unaligned

if TYPE_CHECKING:
    from stages.fuse.stage import FuseConfig


@dataclass(frozen=True)
class CloudFacts:
    """Facts of one fused cloud; the rows of fuse.json."""

    points: int
    extent_m: list[float]
    """Edges of the bounding box [m]."""
    views: int
    """Views that see the object."""
    source: str
    method: str
    disagreement_mm: float | None
    """Median over pairs of views of the median depth difference, before registration [mm]."""
    registered: bool
    """Whether the views were registered to each other."""
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class EpisodeCloud:
    """One object cloud and its facts."""

    cloud: PointCloud
    facts: CloudFacts


def fuse_episode(
    recording: Recording, config: FuseConfig, bad: Mapping[str, str] | None = None, *, judged: bool = True
) -> EpisodeCloud:
    """Fuse one episode.

    Args:
        recording: Open recording.
        config: Settings of the stage.
        bad: Cameras with the verdict bad of calibrate, with the fix; they are left out if another one sees the object.
        judged: Whether calibrate has checked the cameras; otherwise the alignment of depth and colour is checked.

    Returns:
        Object cloud in the world frame, metres.

    Raises:
        PlopError: The object is not seen, units are wrong, or the table is not at the stated height; it has the
            warnings collected before.
    """
    scan = config.source == "scan" or (config.source == "auto" and bool(recording.scan_names))
    views, warnings = _views(recording, config, scan)
    with remembering(warnings):
        if not scan:
            views = _without_bad(views, bad or {}, warnings)
            warnings += [] if judged else unaligned(views)
            check_table(recording, views)
        return _fused(recording, config, scan, views, warnings)


def _fused(
    recording: Recording, config: FuseConfig, scan: bool, views: list[View], warnings: list[str]
) -> EpisodeCloud:
    masks = [view.object_mask for view in views]
    masked = any(mask.any() for mask in masks)
    if not masked:
        masks = [_undecided(view) for view in views]
    used = [i for i, view in enumerate(views) if (masks[i] & (view.depth_m > 0)).any()]
    views, masks = [views[i] for i in used], [masks[i] for i in used]
    if not views:
        raise PlopError(
            "No camera sees the object.",
            where=recording.path,
            expected="pixels of the object (mask) with depth",
            found="none in any camera",
            fix="Check the masks and depth images of this episode.",
            cause=Cause.MASKS,
        )
    clouds = [cloud_from_depth(v.camera, v.depth_m, v.rgb, m) for v, m in zip(views, masks, strict=True)]
    before = view_disagreement_mm(views, masks)
    views, clouds, registered = _registered(views, masks, clouds, before, config, warnings)
    method = config.method if config.method != "auto" else ("tsdf" if scan else "points")
    if method == "tsdf":
        frames = [replace(v, depth_m=np.where(m, v.depth_m, 0)) for v, m in zip(views, masks, strict=True)]
        cloud = fuse_tsdf(frames, config.voxel_m)
    else:
        cloud = voxel_average(join(clouds), config.voxel_m)
    cloud = _cleaned(cloud, recording, masked, config)
    facts = CloudFacts(
        len(cloud),
        [round(float(e), 6) for e in cloud.extent_m],
        len(views),
        "scan" if scan else "first-frame",
        method,
        None if before is None else round(before, 4),
        registered,
        warnings,
    )
    _check_size(facts, recording, config)
    return EpisodeCloud(cloud, facts)


def _views(recording: Recording, config: FuseConfig, scan: bool) -> tuple[list[View], list[str]]:
    if scan and not recording.scan_names:
        raise PlopError(
            "The recording has no scan.",
            where=recording.path,
            expected="frames in /scan",
            found="none",
            fix="Use --set fuse.source=first-frame.",
        )
    group = "scan" if scan else "cameras"
    picks = [(name, config.frame) for name in recording.camera_names]
    if scan:
        picks = [(name, i) for name in recording.scan_names for i in range(recording.scan_length(name))]
        step = max(1, -(-len(picks) // config.scan_views))
        picks = picks[::step]
    views, blind = [], []
    for name, index in picks:
        view = recording.view(name, index, group=group)
        view = replace(view, depth_m=np.nan_to_num(view.depth_m, nan=0.0, posinf=0.0, neginf=0.0))
        check_metres(view.depth_m, f"{recording.path}:/{group}/{name}/depth_m[{index}]")
        if not (view.depth_m > 0).any():
            blind.append(f"{name}[{index}]")
        views.append(view)
    return views, [f"no depth is measured in {', '.join(blind)}"] if blind else []


def _without_bad(views: list[View], bad: Mapping[str, str], warnings: list[str]) -> list[View]:
    good = [view for view in views if view.camera.name not in bad]
    if not any(view.object_mask.any() for view in good) or len(good) == len(views):
        return views
    warnings += [
        f"camera {view.camera.name} is left out, calibrate calls it bad: {bad[view.camera.name]}"
        for view in views
        if view.camera.name in bad
    ]
    return good


def _undecided(view: View) -> np.ndarray:
    """Return pixels that may be the object in recordings without masks."""
    return view.mask == MaskLabel.UNKNOWN


def view_disagreement_mm(views: list[View], masks: list[np.ndarray]) -> float | None:
    """Compare the object's depth between every pair of views; occlusions are not tested.

    Returns:
        Median over pairs of the shown difference [mm]; None when no pair can be compared.
    """
    picks = [
        DepthView(view.camera, np.where(mask, view.depth_m, 0), mask, mask)
        for view, mask in zip(views, masks, strict=True)
    ]
    if len(picks) > 20:
        picks = [picks[i] for i in np.linspace(0, len(picks) - 1, 20).astype(int)]
    pairs = [disagreement([pair]) for pair in combinations(picks, 2)]
    values = [pair.shown_mm for pair in pairs if pair.compared]
    return float(np.median(values)) if values else None


def _registered(
    views: list[View],
    masks: list[np.ndarray],
    clouds: list[PointCloud],
    before: float | None,
    config: FuseConfig,
    warnings: list[str],
) -> tuple[list[View], list[PointCloud], bool]:
    """Register the views to each other where they disagree, if that improves their agreement."""
    if before is None or before <= config.icp_above_mm or len(views) < 2:
        return views, clouds, False
    result = register([voxel_average(cloud, config.voxel_m) for cloud in clouds], gate_m=config.icp_gate_m)
    moved = [
        replace(v, camera=replace(v.camera, world_from_cam=m @ v.camera.world_from_cam))
        for v, m in zip(views, result.corrections, strict=True)
    ]
    refusal = _why_not_kept(result, clouds, config)
    if not refusal:
        after = view_disagreement_mm(moved, masks)
        if after is not None and after < before:
            warnings.append(
                f"the views disagreed by {before:.1f} mm and were registered: they now disagree by {after:.1f} mm"
            )
            return moved, [c.moved(m) for c, m in zip(clouds, result.corrections, strict=True)], True
        refusal = "the views would not overlap then" if after is None else f"they would disagree by {after:.1f} mm"
    text = f"the views disagree by {before:.1f} mm and registration did not help ({refusal}): run `plop calibrate`"
    warnings.append(Noticed(text, Cause.EXTRINSICS, "Run `plop calibrate`, and repair the cameras that it calls bad."))
    return views, clouds, False


def _why_not_kept(result: Registration, clouds: list[PointCloud], config: FuseConfig) -> str:
    """Return why a registration must not be used, "" when it is accepted."""
    if not result.pairs:
        return "no part of the object's surface is seen by two views"
    if not np.isfinite(result.corrections).all() or not np.isfinite(result.residual_after_mm):
        return "it found no finite solution"
    middles = [c.points.mean(0) for c in clouds]
    moved = max(
        float(np.linalg.norm(m[:3, :3] @ p + m[:3, 3] - p)) for m, p in zip(result.corrections, middles, strict=True)
    )
    if moved > config.max_correction_m:
        return f"it would move a view by {1e3 * moved:.1f} mm"
    if not result.residual_after_mm < result.residual_before_mm:
        return f"distances stay at {result.residual_before_mm:.2f} mm"
    return ""


def _cleaned(cloud: PointCloud, recording: Recording, masked: bool, config: FuseConfig) -> PointCloud:
    table = recording.table_z_m
    if masked and table is not None:
        cloud = cloud[cloud.points[:, 2] > table - config.below_table_m]
    elif table is not None:
        cloud = cloud[cloud.points[:, 2] > table + config.table_margin_m]
    elif not masked and len(cloud) > 50:
        height = find_plane(cloud.points, threshold_m=config.table_margin_m).signed_distance(cloud.points)
        above = height > config.table_margin_m
        cloud = cloud[above]
    if not masked:
        cloud = cloud[largest_clusters(cloud.points, 3 * config.voxel_m, at_least=0.5)]
    if config.outlier_deviations > 0:
        cloud = cloud[outlier_free(cloud, deviations=config.outlier_deviations)]
    return cloud


def _check_size(facts: CloudFacts, recording: Recording, config: FuseConfig) -> None:
    if facts.points < config.min_points:
        raise PlopError(
            "Too few points of the object are left.",
            where=recording.path,
            expected=f"at least {config.min_points}",
            found=f"{facts.points}",
            fix="Check masks and table height, or lower --set fuse.voxel_m.",
            cause=Cause.MASKS,
        )
    if max(facts.extent_m) > config.max_extent_m:
        raise PlopError(
            "The object is implausibly large.",
            where=recording.path,
            expected=f"below {config.max_extent_m} m",
            found=f"{max(facts.extent_m):.2f} m",
            fix="Check the masks and that poses and depth are in metres.",
            cause=Cause.MASKS,
        )
