"""eval: score rollouts against measurements, beside two baselines, per frame, episode and environment."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from plop.artifacts.atomic_file import write_json
from plop.errors import PlopError
from plop.metrics.lpips import Backbone, Lpips, Unavailable, load_lpips
from plop.pipeline.parallel import every_piece
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.set import RecordingSet
from plop.render.rasterize import Backend
from plop.setting_kinds import ALL_CORES, SAME_RESULT, Jobs, Range, Seed, Settings, Unit
from stages.eval.episode import EpisodePaths, score_episode
from stages.eval.plot import plot_over_time
from stages.eval.report import environment_report, summary_table, write_csv


@dataclass(frozen=True)
class EvalConfig(Settings):
    """Settings of `eval`; their defaults are written only here."""

    method: str = "plop"
    """Name of the scored rollouts in tables."""
    seed: Seed = 0
    """Seed of the EMD samples and of the bootstrap."""
    emd_every: Annotated[int, Range(0), Unit("frames")] = 1
    """EMD on every so many frames, and always on the first and the last; 0 leaves it out."""
    truth: bool = True
    """Also score material points where the recording holds a simulator's truth."""
    lpips_net: Backbone = "alex"
    """Backbone of LPIPS."""
    lpips_backbone: str = ""
    """File with the backbone's weights; torch's hub folder is searched when empty."""
    backend: Backend = "auto"
    """Renderer of the baselines; see rollout."""
    picture_camera: str = ""
    """Camera of the pictures; when empty, the one whose measured image changes most."""
    threads: Annotated[int, Range(0, 4096), SAME_RESULT] = 0
    """Frames of an episode that are scored at the same time; 0 is one per core."""
    jobs: Jobs = ALL_CORES
    """Episodes at a time, each in a process; -1 is one a core."""


def run(inputs: Inputs, config: EvalConfig, out: Output) -> Summary:
    """Write scores.json, scores.csv, episodes/, pictures/ and over_time.png.

    Raises:
        PlopError: The rollouts do not belong to these recordings or fits, or hold nothing.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    rollouts, init = inputs["rollouts"].path, inputs["init"].path
    names = _episodes(recordings, rollouts)
    lpips = _lpips(config)
    for folder in ("episodes", "pictures"):
        (out.path / folder).mkdir(parents=True, exist_ok=True)
    every_piece(partial(_score, recordings, rollouts, init, config), names, out, jobs=config.jobs)
    rows = [row for name in names for row in json.loads((out.path / "episodes" / f"{name}.json").read_text())]
    report = environment_report(rows, recordings.environment, config)
    if isinstance(lpips, Unavailable):
        report["unavailable"]["lpips"] = lpips.reason
    write_json(out.path / "scores.json", report, sort_keys=False)
    write_csv(out.path / "scores.csv", rows)
    plot_over_time(out.path / "over_time.png", rows, recordings.environment)
    return _summary(report)


def _lpips(config: EvalConfig) -> Lpips | Unavailable:
    return load_lpips(config.lpips_net, config.lpips_backbone)


def _score(recordings: RecordingSet, rollouts: Path, init: Path, config: EvalConfig, name: str, out: Output) -> None:
    paths = EpisodePaths(init / name, rollouts / name, out.path / "pictures" / f"{name}.png")
    scored = score_episode(recordings, name, paths, config, _lpips(config), out.progress)
    write_json(out.path / "episodes" / f"{name}.json", scored, sort_keys=False)


def _episodes(recordings: RecordingSet, rollouts: Path) -> list[str]:
    found = sorted(folder.parent.name for folder in rollouts.glob("*/images.h5"))
    unknown = [name for name in found if name not in recordings.names]
    if unknown:
        raise PlopError(
            "A rollout is of another set of recordings.",
            where=rollouts / unknown[0],
            expected=", ".join(recordings.names),
            found=unknown[0],
            fix="Give the recordings that the rollout was made from.",
        )
    if not found:
        raise PlopError(
            "There is nothing to score.",
            where=rollouts,
            expected="<episode>/images.h5 of `plop rollout`",
            found="no episode",
            fix="Run `plop rollout`.",
        )
    return found


def _summary(report: dict) -> Summary:
    figures = {"episodes": len(report["episodes"])}
    for name, value in report["better_than_persistence_percent"]["episode"].items():
        figures[f"{name}_better_than_persistence_percent"] = value
    warnings = [f"{name} is unavailable: {reason}" for name, reason in report["unavailable"].items()]
    warnings += report["notes"]
    return Summary(figures, summary_table(report), warnings)


STAGE = Stage(
    name="eval",
    version=4,
    help="Score predictions against measurements and two baselines.",
    config=EvalConfig,
    inputs={
        "recordings": InputSpec(("calibrate", "ingest", "simulate"), "what was measured"),
        "init": InputSpec(("fit-init",), "Gaussians at frame 0, for the baselines", along="recordings"),
        "rollouts": InputSpec(("rollout",), "what was predicted", along="recordings"),
    },
    run=run,
)
