"""Calibrate one episode: measure, correct what can be corrected, judge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from plop.recordings.edits import Edits
from plop.recordings.recording import Recording
from stages.calibrate.correct import find_correction
from stages.calibrate.evidence import CameraEvidence, gather
from stages.calibrate.scan import ScanVerdict, check_scan
from stages.calibrate.soundness import check_recording
from stages.calibrate.tool_timing import Offset, episode_offsets, shifted_tool_poses
from stages.calibrate.verdict import CameraVerdict, judge, tolerance_ms
from stages.calibrate.verify import CameraCheck, Change, check_episode, spread_frames

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig

NOBODY_TELLS = (
    "no two cameras agree, so that nobody can tell which one is wrong: none was changed (a third camera, "
    "or a hand-eye calibration of one, would tell)"
)
"""Said of cameras that all disagree."""


@dataclass(frozen=True)
class EpisodeCalibration:
    """What to change in one recording, and the verdicts."""

    edits: Edits
    cameras: list[CameraVerdict]
    scans: list[ScanVerdict] = field(default_factory=list)


def calibrate_episode(
    recording: Recording,
    config: CalibrateConfig,
    reprojection_px: Mapping[str, float] | None = None,
    trusted: frozenset[str] = frozenset(),
) -> EpisodeCalibration:
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
    state = _without_blame(recording, frames, config, _corrected(recording, frames, config, trusted))
    edits, before, evidence = state.edits, state.before, state.evidence
    offsets = episode_offsets(recording, config.max_offset_search_ms) if config.time_offset else {}
    shift = _common_offset_ms(offsets, config)
    if shift is not None:
        edits.world_from_tool = shifted_tool_poses(recording, shift)
    verdicts = [
        judge(
            name,
            before[name],
            state.after[name],
            corrected=state.corrected.get(name),
            depth_scale=state.change[name][1] if name in state.change else 1.0,
            reprojection_px=(reprojection_px or {}).get(name),
            offset=offsets.get(name),
            offset_corrected=shift is not None,
            evidence=evidence[name],
            config=config,
        )
        for name in names
    ]
    off = _off(before, config)
    if (
        not state.corrected
        and not state.faulty
        and len(off) == sum(c.disagreement_mm is not None for c in before.values())
    ):
        verdicts = [
            replace(each, fix=f"{each.fix}; {NOBODY_TELLS}", usable=True) if each.camera in off else each
            for each in verdicts
        ]
    scans = []
    for name in recording.scan_names:
        scan, poses = check_scan(recording, name, config)
        scans.append(scan)
        if poses is not None:
            edits.poses[f"scan/{name}"] = poses
    return EpisodeCalibration(edits, verdicts, scans)


@dataclass(frozen=True)
class _Cameras:
    """What is known of an episode's cameras, and what is changed."""

    before: dict[str, CameraCheck]
    """Agreement as recorded."""
    after: dict[str, CameraCheck]
    """Agreement as passed on."""
    evidence: dict[str, CameraEvidence]
    """Of each camera by itself, as passed on."""
    edits: Edits
    corrected: dict[str, str]
    """Kind of correction per corrected camera."""
    change: Change = field(default_factory=dict)
    """The correction itself."""

    @property
    def faulty(self) -> frozenset[str]:
        """Cameras with a fault of their own."""
        return frozenset(name for name, each in self.evidence.items() if each.faults)


def _corrected(recording: Recording, frames: list[int], config: CalibrateConfig, trusted: frozenset[str]) -> _Cameras:
    """Measure each camera alone and all together, and correct what disagrees where something tells which is right."""
    evidence = gather(recording, frames, config)
    broken = frozenset(name for name, each in evidence.items() if each.broken)
    before = check_episode(recording, frames, config.region_margin_m, leave_out=broken)
    as_recorded = _Cameras(before, before, evidence, Edits(), {})
    lost = any(check.disagreement_mm is None and check.pixels for check in before.values())
    if not config.correct or not (_off(before, config) or (lost and len(before) - len(broken) > 1)):
        return as_recorded
    # a sharp hand-eye answer fixes the whole pose, a table only its height and tilt
    right = frozenset(name for name, each in evidence.items() if each.table_right)
    found = find_correction(
        recording,
        frames,
        config.region_margin_m,
        before,
        config.max_disagreement_mm,
        config.gate_m,
        trusted=trusted or right,
        leave_out=broken,
    )
    if found is None:
        return as_recorded
    moved = gather(recording, frames, config, change=found.change)
    if any(each.faults and not evidence[name].faults for name, each in moved.items()):
        return as_recorded
    edits = Edits()
    for name, (move, factor) in found.change.items():
        _add(edits, recording, name, move, factor)
    return _Cameras(before, found.checks, moved, edits, dict.fromkeys(found.change, found.kind), found.change)


def _without_blame(recording: Recording, frames: list[int], config: CalibrateConfig, state: _Cameras) -> _Cameras:
    """Compare the sound cameras with each other only: one that disagrees with a faulty one is not to blame."""
    faulty = state.faulty
    if faulty == frozenset(state.evidence) or all(state.evidence[name].broken for name in faulty):
        return state  # broken ones were left out from the start
    alone = check_episode(recording, frames, config.region_margin_m, state.change, leave_out=faulty)
    return replace(state, after={name: state.after[name] if name in faulty else alone[name] for name in state.after})


def _off(checks: Mapping[str, CameraCheck], config: CalibrateConfig) -> list[str]:
    return [
        name
        for name, check in checks.items()
        if check.disagreement_mm is not None and check.disagreement_mm > config.max_disagreement_mm
    ]


def _add(edits: Edits, recording: Recording, name: str, move: np.ndarray, factor: float) -> None:
    poses = np.stack([recording.camera(name, frame).world_from_cam for frame in range(len(recording))])
    if not np.allclose(move, np.eye(4), atol=1e-9):
        edits.poses[f"cameras/{name}"] = move @ poses
    if abs(factor - 1) > 1e-9:
        edits.depth[f"cameras/{name}"] = partial(np.multiply, np.float32(factor))


def _common_offset_ms(offsets: Mapping[str, Offset], config: CalibrateConfig) -> float | None:
    """Give the offset that all cameras share, when it is worth correcting: only the tool can be shifted."""
    if not offsets or not config.correct:
        return None
    middle = float(np.median([each.offset_ms for each in offsets.values()]))
    alike = all(abs(each.offset_ms - middle) <= tolerance_ms(each, config) for each in offsets.values())
    least = min(tolerance_ms(each, config) for each in offsets.values())
    return middle if alike and abs(middle) > least else None
