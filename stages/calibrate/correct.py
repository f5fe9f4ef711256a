"""Find the corrections of pose and depth scale that make disagreeing cameras agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.geometry.clouds.pointcloud import cloud_from_depth, voxel_average
from plop.geometry.clouds.registration import Registration, register
from plop.recordings.recording import Recording
from stages.calibrate.verify import CameraCheck, Change, check_episode, depth_views, read_views

VOXEL_M = 0.003
"""Points closer than this are averaged before registration [m]."""


@dataclass(frozen=True)
class Correction:
    """An accepted correction of one episode."""

    change: Change
    kind: str
    """"scale", "pose" or "pose and scale"."""
    checks: dict[str, CameraCheck]
    """Agreement with the correction applied."""


def find_correction(
    recording: Recording,
    frames: list[int],
    margin_m: float,
    before: dict[str, CameraCheck],
    limit_mm: float,
    gate_m: float,
    *,
    trusted: frozenset[str] = frozenset(),
    leave_out: frozenset[str] = frozenset(),
) -> Correction | None:
    """Try depth scales, poses, and both, and keep the simplest that is about as good as the best.

    Cameras within the limit stay where they are; when none is (two cameras that disagree, say), those that something
    else than the other cameras confirms. Where there are none of these either, nobody can tell which camera is wrong,
    and none is changed: a right one would be moved onto a wrong one as likely as not.

    Args:
        recording: Open recording.
        frames: Frames on which the result is judged; the first is used to find it.
        margin_m: How far around the object surfaces take part [m].
        before: Agreement as recorded.
        limit_mm: Disagreement that is good enough [mm].
        gate_m: Largest distance of corresponding points [m].
        trusted: Cameras with evidence of their own that they are right: the table, their hand-eye data.
        leave_out: Cameras with a fault that no pose or scale mends: they are neither moved nor looked at.

    Returns:
        The correction; None when there is nothing to hold on to, or none makes all cameras agree or at
        least halves the worst disagreement.
    """
    names = [name for name in recording.camera_names if name not in leave_out]
    values = [before[name].disagreement_mm for name in names]
    known = [i for i, value in enumerate(values) if value is not None]
    if len(known) < 2:
        return None
    good = [i for i in known if values[i] <= limit_mm]  # type: ignore[operator]
    fixed = good or [i for i in known if names[i] in trusted]
    if not fixed or len(fixed) == len(known):
        return None
    views = read_views(recording, frames[0])
    picks = depth_views([view for view in views if view.camera.name in names], margin_m)
    blank = [np.zeros((*pick.depth_m.shape, 3), np.uint8) for pick in picks]
    clouds = [
        voxel_average(cloud_from_depth(p.camera, p.depth_m, rgb, p.region), VOXEL_M)
        for p, rgb in zip(picks, blank, strict=True)
    ]
    centers = np.stack([pick.camera.world_from_cam[:3, 3] for pick in picks])
    tried = []
    for kind in ("scale", "pose", "pose and scale"):
        found = register(
            clouds, gate_m=gate_m, free_pose="pose" in kind, fixed=fixed, centers=centers if "scale" in kind else None
        )
        if not (np.isfinite(found.corrections).all() and np.isfinite(found.scales).all()):
            continue  # no answer
        change = _as_change(names, found)
        tried.append(Correction(change, kind, check_episode(recording, frames, margin_m, change, leave_out)))
    if not tried:
        return None
    least = min(_worst(each.checks) for each in tried)
    best = next(each for each in tried if _worst(each.checks) <= max(1.3 * least, least + 0.1))
    return best if _worst(best.checks) <= limit_mm or _worst(best.checks) < 0.5 * _worst(before) else None


def _as_change(names: list[str], found: Registration) -> Change:
    moved = [
        not np.allclose(pose, np.eye(4), atol=1e-9) or abs(scale - 1) > 1e-9
        for pose, scale in zip(found.corrections, found.scales, strict=True)
    ]
    return {name: (found.corrections[i], float(found.scales[i])) for i, name in enumerate(names) if moved[i]}


def _worst(checks: dict[str, CameraCheck]) -> float:
    values = [check.disagreement_mm for check in checks.values() if check.disagreement_mm is not None]
    return max(values) if values else float("inf")
