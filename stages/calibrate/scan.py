"""Check the poses of a scan by its depth, and refine them by its images when they disagree."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from plop.errors import PlopError
from plop.geometry.calibration.depth_agreement import disagreement
from plop.geometry.view import View
from plop.recordings.recording import Recording
from stages.calibrate.verify import depth_views

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig


@dataclass(frozen=True)
class ScanVerdict:
    """What is known of one scanning camera; "scan" in calibration.json."""

    camera: str
    views: int
    verdict: str
    """"good", "corrected", "unchecked" or "bad"."""
    disagreement_before_mm: float | None
    disagreement_mm: float | None
    """Median over neighbouring views of the shown depth difference [mm]."""
    reprojection_px: float | None
    """Of the refined scan [px]."""
    fix: str


def check_scan(recording: Recording, name: str, config: CalibrateConfig) -> tuple[ScanVerdict, np.ndarray | None]:
    """Judge a scan and refine its poses if need be (and if the settings allow).

    Args:
        recording: Open recording with /scan/<name>.
        name: The scanning camera.
        config: Settings of the stage.

    Returns:
        The verdict, and new poses [V, 4, 4] when they are better than the recorded ones.
    """
    total = recording.scan_length(name)
    views = [_clean(recording.view(name, index, group="scan")) for index in range(total)]
    before = scan_disagreement_mm(views, config.region_margin_m)
    fine = before is not None and before <= config.max_disagreement_mm
    if config.refine_scan == "never" or (config.refine_scan == "auto" and (fine or not config.correct)):
        return _verdict(name, total, before, before, None, config), None
    from plop.geometry.calibration.bundle_adjust import refine_scan

    picks = np.unique(np.linspace(0, total - 1, min(total, config.max_scan_views)).astype(int))
    try:
        found = refine_scan(
            [views[i].rgb for i in picks],
            [views[i].camera for i in picks],
            scale_from=config.scan_scale,
            depths_m=[views[i].depth_m for i in picks],
        )
    except PlopError as error:
        verdict = _verdict(name, total, before, before, None, config)
        return replace(verdict, fix="; ".join(filter(None, [verdict.fix, error.problem]))), None
    poses = spread_corrections(np.stack([view.camera.world_from_cam for view in views]), picks, found.world_from_cam)
    moved = [replace(v, camera=replace(v.camera, world_from_cam=p)) for v, p in zip(views, poses, strict=True)]
    after = scan_disagreement_mm(moved, config.region_margin_m)
    if found.placed.mean() < 0.8 or after is None or (before is not None and after >= before):
        return _verdict(name, total, before, before, found.reprojection_px, config), None
    return _verdict(name, total, before, after, found.reprojection_px, config), poses


def spread_corrections(poses: np.ndarray, picks: np.ndarray, refined: np.ndarray) -> np.ndarray:
    """Give every view of a scan the correction of the nearest refined view.

    Args:
        poses: Recorded, shape [V, 4, 4].
        picks: Indices of the refined views, ascending, shape [K].
        refined: Their new poses, shape [K, 4, 4].
    """
    nearest = np.abs(np.arange(len(poses))[:, None] - picks).argmin(1)
    return refined[nearest] @ np.linalg.inv(poses[picks[nearest]]) @ poses


def scan_disagreement_mm(views: list[View], margin_m: float, steps: tuple[int, ...] = (1, 3, 7)) -> float | None:
    """Compare views of a scan a few steps apart: median of the shown depth differences [mm]."""
    picks = depth_views(views, margin_m)
    if len(picks) > 40:
        picks = [picks[i] for i in np.linspace(0, len(picks) - 1, 40).astype(int)]
    pairs = [disagreement([(picks[i], picks[i + step])]) for step in steps for i in range(len(picks) - step)]
    values = [pair.shown_mm for pair in pairs if pair.compared]
    return float(np.median(values)) if values else None


def _clean(view: View) -> View:
    return replace(view, depth_m=np.nan_to_num(view.depth_m, nan=0.0, posinf=0.0, neginf=0.0))


def _verdict(
    name: str, views: int, before: float | None, after: float | None, pixels: float | None, config: CalibrateConfig
) -> ScanVerdict:
    verdict, fix = "good", ""
    if after is None:
        verdict, fix = "unchecked", "its views share no measured surface: scan slower, closer"
    elif after > config.max_disagreement_mm:
        verdict, fix = "bad", f"its views disagree by {after:.1f} mm: repeat the hand-eye calibration of this camera"
    elif before != after:
        verdict, fix = "corrected", "poses were refined by the images; calibrate the wrist camera again"

    def rounded(value: float | None) -> float | None:
        return None if value is None else round(value, 4)

    return ScanVerdict(name, views, verdict, rounded(before), rounded(after), rounded(pixels), fix)
