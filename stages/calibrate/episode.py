"""Calibrate one episode: measure, correct what can be corrected, judge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from plop.recordings.recording import Recording
from stages.calibrate.correct import find_correction
from stages.calibrate.evidence import gather
from stages.calibrate.pass_on import Edits
from stages.calibrate.scan import ScanVerdict, check_scan
from stages.calibrate.soundness import check_recording
from stages.calibrate.tool_timing import Offset, episode_offsets, shifted_tool_poses
from stages.calibrate.verdict import CameraVerdict, judge, tolerance_ms
from stages.calibrate.verify import check_episode, spread_frames

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig

NOBODY_TELLS = ("no two cameras agree, so that nobody can tell which one is wrong: none was changed (a third camera, "
                "or a hand-eye calibration of one, would tell)")  # fmt: skip
"""Said of cameras that all disagree."""


@dataclass(frozen=True)
class EpisodeCalibration:
    """What to change in one recording, and the verdicts."""

    edits: Edits
    cameras: list[CameraVerdict]
    scans: list[ScanVerdict] = field(default_factory=list)


def calibrate_episode(recording: Recording, config: CalibrateConfig,
                      reprojection_px: Mapping[str, float] | None = None,
                      trusted: frozenset[str] = frozenset()) -> EpisodeCalibration:  # fmt: skip
    """Calibrate one episode.

    Args:
        recording: Open recording, with board and hand-eye results already applied.
        config: Settings of the stage.
        reprojection_px: Error of board images per camera [px].
        trusted: Cameras whose pose is confirmed by something else than the other cameras.

    Raises:
        PlopError: Images or tool cannot be what they claim (units), or nothing was seen.
    """
    names = recording.camera_names
    frames = spread_frames(len(recording), config.check_frames)
    check_recording(recording, frames)
    evidence = gather(recording, frames, config)
    broken = frozenset(name for name, each in evidence.items() if each.broken)
    before = check_episode(recording, frames, config.region_margin_m, leave_out=broken)
    edits, after, corrected, scales = Edits(), before, {}, dict.fromkeys(names, 1.0)
    off = [n for n, c in before.items() if c.disagreement_mm is not None
           and c.disagreement_mm > config.max_disagreement_mm]  # fmt: skip
    lost = [n for n, c in before.items() if c.disagreement_mm is None and c.pixels]
    if config.correct and (off or (lost and len(names) - len(broken) > 1)):
        # a sharp hand-eye answer fixes the whole pose, a table only its height and tilt
        right = frozenset(name for name, each in evidence.items() if each.table_right)
        found = find_correction(recording, frames, config.region_margin_m, before, config.max_disagreement_mm,
                                config.gate_m, trusted=trusted or right, leave_out=broken)  # fmt: skip
        moved = evidence if found is None else gather(recording, frames, config, change=found.change)
        if found is not None and not any(each.faults and not evidence[name].faults for name, each in moved.items()):
            after, evidence = found.checks, moved
            for name, (move, factor) in found.change.items():
                corrected[name] = found.kind
                scales[name] = factor
                _add(edits, recording, name, move, factor)
    faulty = frozenset(name for name, each in evidence.items() if each.faults)
    if faulty - broken and faulty != frozenset(names):
        # a camera that disagrees only with one whose own table is off is not to blame
        alone = check_episode(recording, frames, config.region_margin_m, leave_out=faulty)
        after = {name: after[name] if name in faulty else alone[name] for name in names}
    offsets = episode_offsets(recording, config.max_offset_search_ms) if config.time_offset else {}
    shift = _common_offset_ms(offsets, config)
    if shift is not None:
        edits.world_from_tool = shifted_tool_poses(recording, shift)
    verdicts = [judge(name, before[name], after[name], corrected=corrected.get(name), depth_scale=scales[name],
                      reprojection_px=(reprojection_px or {}).get(name), offset=offsets.get(name),
                      offset_corrected=shift is not None, evidence=evidence[name], config=config)
                for name in names]  # fmt: skip
    if not corrected and not faulty and len(off) == len([n for n in names if before[n].disagreement_mm is not None]):
        verdicts = [replace(each, fix=f"{each.fix}; {NOBODY_TELLS}") if each.camera in off else each
                    for each in verdicts]  # fmt: skip
    scans = []
    for name in recording.scan_names:
        scan, poses = check_scan(recording, name, config)
        scans.append(scan)
        if poses is not None:
            edits.poses[f"scan/{name}"] = poses
    return EpisodeCalibration(edits, verdicts, scans)


def _add(edits: Edits, recording: Recording, name: str, move: np.ndarray, factor: float) -> None:
    poses = np.stack([recording.camera(name, frame).world_from_cam for frame in range(len(recording))])
    if not np.allclose(move, np.eye(4), atol=1e-9):
        edits.poses[f"cameras/{name}"] = move @ poses
    if abs(factor - 1) > 1e-9:
        edits.depth_factors[f"cameras/{name}"] = factor


def _common_offset_ms(offsets: Mapping[str, Offset], config: CalibrateConfig) -> float | None:
    """Give the offset that all cameras share, when it is worth correcting: only the tool can be shifted."""
    if not offsets or not config.correct:
        return None
    middle = float(np.median([each.offset_ms for each in offsets.values()]))
    alike = all(abs(each.offset_ms - middle) <= tolerance_ms(each, config) for each in offsets.values())
    least = min(tolerance_ms(each, config) for each in offsets.values())
    return middle if alike and abs(middle) > least else None
