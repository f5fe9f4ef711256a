"""fuse: one object cloud with normals per episode, from the first frame of all cameras or from a scan."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from plop.artifacts.atomic_file import write_json, write_text
from plop.errors import PlopError, remembering
from plop.geometry.cloud_ply import write_cloud
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.camera_verdicts import bad_cameras, only_bad_cameras
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet
from plop.setting_kinds import COMMON, Range, Settings, Unit
from stages.fuse.episode import EpisodeCloud, fuse_episode


@dataclass(frozen=True)
class FuseConfig(Settings):
    """Settings of `fuse`; their defaults are written only here."""

    source: Annotated[Literal["auto", "first-frame", "scan"], COMMON] = "auto"
    """"first-frame" (all cameras), "scan" (the recording's /scan cameras), or "auto": the scan where there is one."""
    method: Annotated[Literal["auto", "points", "tsdf"], COMMON] = "auto"
    """"points" (voxel average), "tsdf" (signed distance volume), or "auto": tsdf for a scan, else points."""
    voxel_m: Annotated[float, Range(1e-4, 0.1), Unit("m"), COMMON] = 0.002
    """Edge of one averaging voxel, or of one voxel of the signed distance volume."""
    frame: Annotated[int, Range(0), COMMON] = 0
    """Frame of the interaction that "first-frame" uses."""
    scan_views: Annotated[int, Range(1), Unit("frames")] = 60
    """At most this many of a scan are used, evenly spread."""
    icp_above_mm: Annotated[float, Range(0), Unit("mm")] = 1.5
    """Views that disagree by more than this are registered to each other first."""
    icp_gate_m: Annotated[float, Range(0, 1), Unit("m")] = 0.02
    """Largest distance of corresponding points in registration."""
    max_correction_m: Annotated[float, Range(0, 1), Unit("m")] = 0.03
    """A registration that moves a view further than this is refused."""
    table_margin_m: Annotated[float, Range(0, 1), Unit("m"), COMMON] = 0.004
    """Without masks, points lower than this above the table are table."""
    below_table_m: Annotated[float, Range(0, 1), Unit("m")] = 0.002
    """With masks, points deeper than this below the table are noise."""
    outlier_deviations: Annotated[float, Range(0)] = 4.0
    """Robust standard deviations of neighbour distance at which a point is an outlier; 0 keeps all."""
    min_points: Annotated[int, Range(1), Unit("points")] = 100
    """Fewer than this are no object: the episode is skipped."""
    max_extent_m: Annotated[float, Range(1e-3, 100), Unit("m")] = 2.0
    """An object larger than this is a mistake in units."""


def run(inputs: Inputs, config: FuseConfig, out: Output) -> Summary:
    """Write clouds/<episode>.ply and fuse.json; an episode that cannot be fused is skipped with a warning."""
    recordings = RecordingSet.load(inputs["recordings"].path)
    (out.path / "clouds").mkdir(parents=True, exist_ok=True)
    rows: dict[str, dict] = {}
    skipped: dict[str, str] = {}
    advice = ""
    names, bad = recordings.names, only_bad_cameras(recordings.folder)
    for done, name in enumerate(names):
        facts = out.path / "clouds" / f"{name}.json.part"
        if out.is_done(name):
            saved = json.loads(facts.read_text())
        else:
            saved = _one(recordings, name, config, out.path / "clouds", [bad[name]] if name in bad else [])
            write_text(facts, json.dumps(saved))
            out.mark_done(name)
        (skipped if "skipped" in saved else rows)[name] = saved.get("skipped", saved)
        advice = advice or saved.get("fix", "")
        out.progress(done + 1, len(names), name)
    if not rows:
        reason = next(iter(skipped.values()), "the set holds no episode")
        raise PlopError(
            "No episode could be fused.",
            where=recordings.folder,
            expected="at least one object cloud",
            found=reason,
            fix=advice or "Ingest recordings with an episode that can be used.",
        )
    write_json(out.path / "fuse.json", {"episodes": rows, "skipped": skipped})
    for name in names:
        (out.path / "clouds" / f"{name}.json.part").unlink(missing_ok=True)
    return _summary(rows, skipped)


def _one(recordings: RecordingSet, name: str, config: FuseConfig, folder: Path, known: list[str]) -> dict:
    try:
        with remembering(known), recordings.open(name) as recording:
            bad = bad_cameras(recordings.folder, name)
            result: EpisodeCloud = fuse_episode(_usable(recording, config), config, bad)
    except PlopError as error:
        reason = error.first_cause()
        return {"skipped": reason.one_line(), "fix": reason.fix}
    write_cloud(folder / f"{name}.ply", result.cloud)
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
    version=3,
    help="Fuse the first frame of all cameras, or a scan, into one object cloud with normals.",
    config=FuseConfig,
    inputs={"recordings": InputSpec(("calibrate", "ingest", "simulate"), "recordings with camera poses")},
    run=run,
)
