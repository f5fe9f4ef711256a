"""One verdict per camera: what was measured, whether it may be used, and what to do if not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plop.errors import PlopError
from stages.calibrate.evidence import CameraEvidence
from stages.calibrate.verify import CameraCheck

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig
    from stages.calibrate.tool_timing import Offset

ORDER = ("good", "corrected", "agreed", "unchecked", "bad")
"""Verdicts from best to worst."""


@dataclass(frozen=True)
class CameraVerdict:
    """What is known of one camera in one episode; the rows of calibration.json."""

    camera: str
    verdict: str
    """"good": agrees with the other cameras, and with colour edges, table or tool; "corrected": was off, the passed-on
    recording is right; "agreed": with the other cameras, and nothing else could be looked at; "unchecked": no other
    camera sees the same; "bad"."""
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
    checks: str = ""
    """What agreed beside the other cameras, of "edges", "flat", "table" and "tool", with + between."""
    edges_px: float | None = None
    """How far depth lies from the edges of the colour picture [px]; None when its outlines do not tell."""
    table_mm: float | None = None
    """Table under the object, as this camera sees it, over table_z [mm]."""
    table_deg: float | None = None
    """Its tilt [deg]."""
    tool_share: float | None = None
    """Share of the drawn tool that depth shows, of what is not hidden, 0 to 1."""
    faults: tuple[str, ...] = ()
    """Kinds of faults that these checks found, see `evidence.Fault`."""
    usable: bool = True
    """False where what is made of its pictures would be wrong: a fault is named, it sees nothing, or it disagrees with
    cameras that agree. Where no two agree, it may be right."""


def judge(
    name: str,
    before: CameraCheck,
    after: CameraCheck,
    *,
    corrected: str | None,
    depth_scale: float,
    reprojection_px: float | None,
    offset: Offset | None,
    offset_corrected: bool,
    evidence: CameraEvidence,
    config: CalibrateConfig,
) -> CameraVerdict:
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
        evidence: What its pictures say of themselves, as passed on.
        config: Limits.
    """
    verdict, fixes = "good" if evidence.placed else "agreed", list[str]()
    if corrected:
        verdict = "corrected"
        fixes.append(f"{corrected} corrected here; calibrate the camera again before recording more")
    if evidence.faults:
        verdict = "bad"
        # the first cause only: a table that is off follows from pictures that are turned or not aligned
        fixes.append(next(iter(evidence.faults.values())))
    elif after.disagreement_mm is None:
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
            verdict = "corrected" if verdict in ("good", "agreed") else verdict
            fixes.append(f"{lag}: the tool's poses were shifted")
        else:
            verdict = "bad"
            fixes.append(f"{lag}: shift this camera's timestamps at ingest")
    fixes += filter(None, [evidence.remark])
    far = after.disagreement_mm is None or after.disagreement_mm > config.max_disagreement_mm
    usable = verdict != "bad" or not (evidence.faults or far)
    return CameraVerdict(
        name,
        verdict,
        "; ".join(fixes),
        _rounded(after.disagreement_mm),
        _rounded(before.disagreement_mm),
        round(depth_scale, 6),
        _rounded(reprojection_px),
        _rounded(offset.offset_ms if offset else None),
        _rounded(offset.resolution_ms if offset else None),
        after.partners,
        **_looked_at(evidence),
        usable=usable,
    )


def _looked_at(evidence: CameraEvidence) -> dict[str, Any]:
    edges, tool, support = evidence.edges, evidence.tool, evidence.support
    return {
        "checks": "+".join(evidence.agreed),
        "edges_px": round(edges.off_px, 2) if edges is not None and edges.tells else None,
        "table_mm": None if evidence.table_mm is None else round(evidence.table_mm, 2) + 0.0,
        "table_deg": round(support.tilt_deg, 2) if support and evidence.table_mm is not None else None,
        "tool_share": None if tool is None or tool.through is None else round(1 - tool.through, 3),
        "faults": tuple(fault.value for fault in evidence.faults),
    }


def check_usable(cameras: list[CameraVerdict], where: Path) -> None:
    """Refuse an episode none of whose cameras is usable: what is made of it would be wrong.

    Cameras of which no two agree pass: one of them may be right, and `fuse` says so.

    Raises:
        PlopError: Names what is wrong, the cause that most cameras share first.
    """
    if not cameras or any(each.usable for each in cameras):
        return
    kinds = Counter(each.faults[:1] for each in cameras)
    cause, _ = max(kinds.items(), key=lambda item: (bool(item[0]), item[1]))
    said: dict[str, list[str]] = {}
    for each in sorted(cameras, key=lambda each: each.faults[:1] != cause):
        said.setdefault(each.fix, []).append(each.camera)
    raise PlopError(
        "All its cameras are bad: nothing that is made of it would be right.",
        where=where,
        expected="one camera or more that can be used",
        found="; ".join(f"{', '.join(names)}: {fix}" for fix, names in said.items()),
        fix="Mend the first cause and ingest again, or --keep-bad to go on.",
    )


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
