"""fuse: one object cloud with normals per episode, from the first frame of all cameras or from a scan."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np

from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Clouds
from plop.errors import PlopError, remembering
from plop.geometry.clouds.cloud_ply import write_cloud
from plop.pipeline.stage import Inputs, Output, Stage, Summary
from plop.recordings.camera_verdicts import are_judged, bad_cameras, only_bad_cameras
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet
from plop.setting_kinds import ALL_CORES, COMMON, Jobs, Range, Settings, Unit
from stages.common_inputs import recordings_input
from stages.fuse.episode import EpisodeCloud, fuse_episode


@dataclass(frozen=True)
class FuseConfig(Settings):
    """Settings of `fuse`; their defaults are defined only here."""

    source: Annotated[Literal["auto", "first-frame", "scan"], COMMON] = "auto"
    """"first-frame" (all cameras), "scan" (the recording's /scan cameras), or "auto": the scan where there is one."""
    method: Annotated[Literal["auto", "points", "tsdf"], COMMON] = "auto"
    """"points" (voxel average), "tsdf" (signed distance volume), or "auto": tsdf for a scan, else points."""
    voxel_m: Annotated[float, Range(1e-4, 0.1), Unit("m"), COMMON] = 0.002
    """Edge of one averaging voxel, or of one voxel of the signed distance volume."""
    frame: Annotated[int, Range(0), COMMON] = 0
    """Frame of the interaction that "first-frame" uses."""
    scan_views: Annotated[int, Range(1), Unit("frames")] = 60
    """Largest number of scan frames, evenly spread."""
    icp_above_mm: Annotated[float, Range(0), Unit("mm")] = 1.5
    """Disagreement above which views are registered to each other first."""
    icp_gate_m: Annotated[float, Range(0, 1), Unit("m")] = 0.02
    """Largest distance of corresponding points in registration."""
    max_correction_m: Annotated[float, Range(0, 1), Unit("m")] = 0.03
    """Largest motion of a view in an accepted registration."""
    table_margin_m: Annotated[float, Range(0, 1), Unit("m"), COMMON] = 0.004
    """Without masks, height above the table below which points belong to it."""
    below_table_m: Annotated[float, Range(0, 1), Unit("m")] = 0.002
    """With masks, depth below the table beyond which points are noise."""
    outlier_deviations: Annotated[float, Range(0)] = 4.0
    """Robust standard deviations of neighbour distance at which a point is an outlier; 0 keeps all."""
    min_points: Annotated[int, Range(1), Unit("points")] = 100
    """Smallest number of points of an object; with fewer the episode is skipped."""
    max_extent_m: Annotated[float, Range(1e-3, 100), Unit("m")] = 2.0
    """Largest plausible object; larger ones indicate wrong units."""
    jobs: Annotated[Jobs, COMMON] = ALL_CORES
    """Number of parallel processes, one episode each; -1 is one per core."""


def run(inputs: Inputs, config: FuseConfig, out: Output) -> Summary:
    """Write clouds/<episode>.ply and fuse.json; an episode that cannot be fused is skipped with a warning."""
    recordings = RecordingSet.load(inputs["recordings"].path)
    done = out.map(recordings.names, partial(_one, recordings, config), jobs=config.jobs, keep_going=True)
    rows, reasons = done.values, {name: error.first_cause() for name, error in done.errors.items()}
    skipped = {name: reason.one_line() for name, reason in reasons.items()}
    if not rows:
        reason = next(iter(skipped.values()), "the set has no episode")
        advice = next((each.fix for each in reasons.values() if each.fix), None)
        raise PlopError(
            "No episode could be fused.",
            where=recordings.folder,
            expected="at least one object cloud",
            found=reason,
            fix=advice or "Ingest recordings with a usable episode.",
        )
    write_json(Clouds(out.path).facts, {"episodes": rows, "skipped": skipped})
    return _summary(rows, skipped)


def _one(recordings: RecordingSet, config: FuseConfig, name: str, out: Output) -> dict[str, Any]:
    wrong = only_bad_cameras(recordings.folder)
    known = [wrong[name]] if name in wrong else []
    with remembering(known), recordings.open(name) as recording:
        bad = bad_cameras(recordings.folder, name)
        result: EpisodeCloud = fuse_episode(
            _usable(recording, config), config, bad, judged=are_judged(recordings.folder)
        )
    write_cloud(Clouds(out.path).cloud(name), result.cloud)
    return asdict(result.facts) | {"warnings": known + result.facts.warnings}


def _usable(recording: Recording, config: FuseConfig) -> Recording:
    if config.frame >= len(recording):
        raise PlopError(
            "The recording is shorter than the frame to fuse.",
            where=recording.path,
            expected=f"more than {config.frame} frames",
            found=f"{len(recording)} frames",
            fix="Lower --set fuse.frame.",
        )
    return recording


def _summary(rows: dict[str, dict], skipped: dict[str, str]) -> Summary:
    table = [
        {
            "episode": name,
            "points": row["points"],
            "extent_mm": "x".join(f"{1e3 * e:.0f}" for e in row["extent_m"]),
            "views": row["views"],
            "disagreement_mm": row["disagreement_mm"],
            "registered": row["registered"],
        }
        for name, row in rows.items()
    ]
    worst = [row["disagreement_mm"] for row in rows.values() if row["disagreement_mm"] is not None]
    figures = {
        "episodes": len(rows),
        "skipped": len(skipped),
        "points_median": int(np.median([row["points"] for row in rows.values()])),
    }
    if worst:
        figures["disagreement_mm"] = max(worst)
    warnings = [f"{name} was skipped: {reason}" for name, reason in skipped.items()]
    return Summary(figures, table, warnings + [f"{n}: {w}" for n, row in rows.items() for w in row["warnings"]])


STAGE = Stage(
    name="fuse",
    version=4,
    help="Fuse the first frame of all cameras, or a scan, into one object cloud with normals.",
    config=FuseConfig,
    inputs={"recordings": recordings_input("recordings with camera poses")},
    run=run,
)
