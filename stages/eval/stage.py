"""eval: score rollouts against measurements, beside two baselines, per frame, episode and environment."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from math import inf
from pathlib import Path

from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Fits, Rollouts, ScoreFiles
from plop.checked_settings import check_choices, check_jobs, check_ranges
from plop.errors import PlopError
from plop.metrics.lpips import Lpips, Unavailable, load_lpips
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary, settings_only
from plop.recordings.set import RecordingSet
from plop.render.rasterize import BACKENDS
from stages.eval.episode import EpisodePaths, score_episode
from stages.eval.plot import plot_over_time
from stages.eval.report import environment_report, summary_table, write_csv


@dataclass(frozen=True)
class EvalConfig:
    """Settings of `eval`; their defaults are written only here."""

    method: str = "plop"
    """Name of the scored rollouts in tables."""
    seed: int = 0
    """Seed of the EMD samples and of the bootstrap."""
    emd_every: int = 1
    """EMD on every so many frames, and always on the first and the last; 0 leaves it out."""
    truth: bool = True
    """Also score material points where the recording holds a simulator's truth."""
    lpips_net: str = "alex"
    """Backbone of LPIPS: "alex" or "vgg"."""
    lpips_backbone: str = ""
    """File with the backbone's weights; torch's hub folder is searched when empty."""
    backend: str = "auto"
    """Renderer of the baselines; see rollout."""
    picture_camera: str = ""
    """Camera of the pictures; when empty, the one whose measured image changes most."""
    threads: int = field(default=0, metadata={"in_fingerprint": False})
    """Frames of an episode that are scored at the same time; 0 is one per core."""
    jobs: int = field(default=-1, metadata={"in_fingerprint": False})
    """Episodes at a time, each in a process; -1 is one a core."""


def run(inputs: Inputs, config: EvalConfig, out: Output) -> Summary:
    """Write scores.json, scores.csv, episodes/, pictures/ and over_time.png.

    Raises:
        PlopError: The rollouts do not belong to these recordings or fits, or hold nothing.
    """
    _check(config)
    recordings = RecordingSet.load(inputs["recordings"].path)
    rollouts, init = inputs["rollouts"].path, inputs["init"].path
    names = _episodes(recordings, rollouts)
    lpips = _lpips(config)
    done = out.map(names, partial(_score, recordings, rollouts, init, config), jobs=config.jobs)
    rows = [row for scored in done.values.values() for row in scored]
    report = environment_report(rows, recordings.environment, config)
    if isinstance(lpips, Unavailable):
        report["unavailable"]["lpips"] = lpips.reason
    write_json(ScoreFiles(out.path).report, report, sort_keys=False)
    write_csv(ScoreFiles(out.path).table, rows)
    plot_over_time(ScoreFiles(out.path).over_time, rows, recordings.environment)
    return _summary(report)


def _check(config: EvalConfig) -> None:
    check_choices(config, "eval", {"lpips_net": ("alex", "vgg"), "backend": BACKENDS})
    check_jobs(config, "eval")
    check_ranges(config, "eval", {"emd_every": (0, inf), "threads": (0, 4096)})


def _lpips(config: EvalConfig) -> Lpips | Unavailable:
    return load_lpips(config.lpips_net, config.lpips_backbone)  # type: ignore[arg-type]


def _score(
    recordings: RecordingSet, rollouts: Path, init: Path, config: EvalConfig, name: str, out: Output
) -> list[dict]:
    paths = EpisodePaths(Fits(init).episode(name), Rollouts(rollouts).episode(name), ScoreFiles(out.path).picture(name))
    scored = score_episode(recordings, name, paths, config, _lpips(config), out.progress)
    write_json(ScoreFiles(out.path).rows(name), scored, sort_keys=False)
    return scored


def _episodes(recordings: RecordingSet, rollouts: Path) -> list[str]:
    found = [rollout.folder.name for rollout in Rollouts(rollouts).all]
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
    check=settings_only(_check),
)
