"""One verdict per camera: what was measured, whether it may be used, and what to do if not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from stages.calibrate.verify import CameraCheck

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig
    from stages.calibrate.tool_timing import Offset

ORDER = ("good", "corrected", "unchecked", "bad")
"""Verdicts from best to worst."""


@dataclass(frozen=True)
class CameraVerdict:
    """What is known of one camera in one episode; the rows of calibration.json."""

    camera: str
    verdict: str
    """"good"; "corrected" (was off, the passed-on recording is right); "unchecked" (nothing to compare with); "bad"."""
    fix: str
    """What to do, empty when nothing."""
    disagreement_mm: float | None
    """Depth against the other cameras', as passed on [mm]."""
    disagreement_before_mm: float | None
    """The same as recorded [mm]."""
    depth_scale: float
    """Factor applied to the camera's depth."""
    reprojection_px: float | None
    """Root mean square from board images or from the refined scan [px]; None when neither was given."""
    time_offset_ms: float | None
    """Image time minus robot time [ms]; None when the tool's motion does not tell."""
    time_resolution_ms: float | None
    """How finely it can tell: the tool moves half a pixel in this time [ms]."""
    partners: int
    """Cameras that see part of the same surface."""


def judge(name: str, before: CameraCheck, after: CameraCheck, *, corrected: str | None, depth_scale: float,
          reprojection_px: float | None, offset: Offset | None, offset_corrected: bool,
          config: CalibrateConfig) -> CameraVerdict:  # fmt: skip
    """Turn measurements of one camera into a verdict.

    Args:
        name: The camera.
        before: Agreement as recorded.
        after: Agreement as passed on.
        corrected: What kind of correction was applied to this camera, None when none.
        depth_scale: Factor applied to its depth.
        reprojection_px: From board images or the scan [px].
        offset: Of its images against the robot.
        offset_corrected: Whether the tool's poses were shifted by it.
        config: Limits.
    """
    verdict, fixes = "good", []
    if corrected:
        verdict = "corrected"
        fixes.append(f"{corrected} corrected here; calibrate the camera again before recording more")
    if after.disagreement_mm is None:
        verdict = "unchecked" if after.pixels else "bad"
        fixes.append(_why_not_compared(after))
    elif after.disagreement_mm > config.max_disagreement_mm:
        verdict = "bad"
        fixes.append(_why_it_disagrees(after))
    if reprojection_px is not None and reprojection_px > config.max_reprojection_px:
        verdict = "bad"
        fixes.append(f"the board fits only to {reprojection_px:.2f} px: take sharper, more varied board images")
    if offset is not None and abs(offset.offset_ms) > tolerance_ms(offset, config):
        lag = f"the images lag the robot by {offset.offset_ms:.0f} ms"
        if offset_corrected:
            verdict = "corrected" if verdict == "good" else verdict
            fixes.append(f"{lag}: the tool's poses were shifted")
        else:
            verdict = "bad"
            fixes.append(f"{lag}: shift this camera's timestamps at ingest")
    return CameraVerdict(name, verdict, "; ".join(fixes), _rounded(after.disagreement_mm),
                         _rounded(before.disagreement_mm), round(depth_scale, 6), _rounded(reprojection_px),
                         _rounded(offset.offset_ms if offset else None),
                         _rounded(offset.resolution_ms if offset else None),
                         after.partners)  # fmt: skip


def tolerance_ms(offset: Offset, config: CalibrateConfig) -> float:
    """Largest time offset that is still good: the limit, or what the tool's motion can resolve [ms]."""
    return max(config.max_offset_ms, offset.resolution_ms)


def _why_not_compared(check: CameraCheck) -> str:
    if check.pixels == 0:
        return "it sees nothing near the object: check that its depth is recorded and that it points at the object"
    if check.ratio is not None and abs(check.ratio - 1) > 0.1:
        return f"its depth is {1 / check.ratio:.2f} times the others': check units and extrinsics"
    return "no other camera sees the same surface: it cannot be verified"


def _why_it_disagrees(check: CameraCheck) -> str:
    parts = f"its depth disagrees by {check.disagreement_mm:.1f} mm"
    if check.bias_mm is not None and check.disagreement_mm and abs(check.bias_mm) > 0.8 * check.disagreement_mm:
        parts += f" (mostly one way, {check.bias_mm:+.1f} mm: depth scale or pose)"
    return parts + ": repeat the hand-eye calibration of this camera (--board-images, --handeye) or leave it out"


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(float(value), 4) + 0.0
