"""eval: score rollouts, two baselines and, on request, cheap rivals against measurements.

Scores are given per frame, episode and environment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Fits, Rollouts, ScoreFiles
from plop.artifacts.store import Artifact
from plop.errors import PlopError
from plop.metrics.lpips import Backbone, Lpips, Unavailable, load_lpips
from plop.metrics.scores import Scores
from plop.pipeline.stage import Choice, Inputs, InputSpec, Output, Recipe, Stage, Summary
from plop.recordings.set import RecordingSet
from plop.render.rasterizer.rasterize import Backend
from plop.setting_kinds import ALL_CORES, COMMON, SAME_RESULT, Jobs, Range, Seed, Settings, Unit
from stages import MODELS
from stages.common_inputs import init_input, measured_input, recordings_input
from stages.eval.bands import has_band, score_bands_of
from stages.eval.episode import EpisodePaths, score_episode
from stages.eval.plot import plot_over_time
from stages.eval.report import scores_of, summary_table, write_csv
from stages.eval.rivals import Rivals


@dataclass(frozen=True)
class EvalConfig(Settings):
    """Settings of `eval`; their defaults are defined only here."""

    method: Annotated[str, COMMON] = "plop"
    """Name of the scored rollouts in tables."""
    seed: Annotated[Seed, COMMON] = 0
    """Seed of the EMD samples and of the bootstrap."""
    emd_every: Annotated[int, Range(0), Unit("frames"), COMMON] = 1
    """Interval of the frames scored by EMD, besides the first and the last; 0 disables EMD."""
    observed_frames: Annotated[int, Range(0), Unit("frames"), COMMON] = 0
    """Measured frames after frame 0 that the rivals "velocity" and, with an engine, "residual" see; 0: no such
    rivals."""
    truth: bool = True
    """Also score material points where the recording has a simulator's ground truth."""
    lpips_net: Backbone = "alex"
    """Backbone of LPIPS."""
    lpips_backbone: str = ""
    """File with the backbone's weights; torch's hub folder is searched when empty."""
    backend: Backend = "auto"
    """Renderer of the baselines; see rollout."""
    picture_camera: str = ""
    """Camera of the pictures; when empty, the one whose measured image changes most."""
    threads: Annotated[int, Range(0, 4096), SAME_RESULT] = 0
    """Frames of an episode that are scored in parallel; 0 is one per core."""
    jobs: Annotated[Jobs, COMMON] = ALL_CORES
    """Number of parallel processes, one episode each; -1 is one per core."""


def run(inputs: Inputs, config: EvalConfig, out: Output) -> Summary:
    """Write scores.json, scores.csv, episodes/, pictures/ and over_time.png; of a band also bands.json and bands.png.

    Raises:
        PlopError: The rollouts do not belong to these recordings or fits, or are empty; a rival's input is of another
            kind.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    rollouts, init = inputs["rollouts"].path, inputs["init"].path
    names = _episodes(recordings, rollouts)
    given = {name: inputs[name].path if name in inputs else None for name in ("engine", "tracks")}
    rivals = Rivals(recordings, given["engine"], given["tracks"], config.observed_frames)
    rivals.check()
    lpips = _lpips(config)
    done = out.map(names, partial(_score, recordings, rollouts, init, rivals, config), jobs=config.jobs)
    rows = [row for scored in done.values.values() for row in scored]
    unavailable = {"lpips": lpips.reason} if isinstance(lpips, Unavailable) else {}
    scores = scores_of(rows, recordings.environment, config, unavailable)
    scores.write(out.path)
    write_csv(ScoreFiles(out.path).table, rows)
    plot_over_time(ScoreFiles(out.path).over_time, rows, recordings.environment)
    banded = has_band(config, inputs)
    more = score_bands_of(inputs, recordings, names, config.seed, out.path) if banded else ({}, [])
    return _summary(scores, *more)


def _lpips(config: EvalConfig) -> Lpips | Unavailable:
    return load_lpips(config.lpips_net, config.lpips_backbone)


def _score(
    recordings: RecordingSet, rollouts: Path, init: Path, rivals: Rivals, config: EvalConfig, name: str, out: Output
) -> list[dict]:
    paths = EpisodePaths(Fits(init).episode(name), Rollouts(rollouts).episode(name), ScoreFiles(out.path).picture(name))
    scored = score_episode(recordings, name, paths, config, _lpips(config), rivals, out.progress)
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
            fix="Use the recordings that the rollout was made from.",
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


def _summary(scores: Scores, more: Mapping[str, float], more_warnings: list[str]) -> Summary:
    figures: dict[str, float] = {"episodes": len(scores.episodes)}
    for name, value in scores.better_than_persistence_percent["episode"].items():
        figures[f"{name}_better_than_persistence_percent"] = value
    warnings = [f"{name} is unavailable: {reason}" for name, reason in scores.unavailable.items()]
    return Summary(figures | dict(more), summary_table(scores), [*warnings, *scores.notes, *more_warnings])


def _all_where_none_is_for_testing(inputs: Mapping[str, Artifact]) -> tuple[dict[str, str], str]:
    """Roll out all episodes of recordings without test episodes: otherwise nothing could be scored."""
    if RecordingSet.load(inputs["recordings"].path).test:
        return {}, ""
    return {"split": "all"}, f"{inputs['recordings'].address} has no test episode: all its episodes are rolled out"


STAGE = Stage(
    name="eval",
    version=7,
    help="Score predictions against measurements and two baselines.",
    config=EvalConfig,
    inputs={
        "recordings": recordings_input("the measurements", Choice.UNAMBIGUOUS),
        "init": init_input("Gaussians at frame 0, for the baselines"),
        "rollouts": InputSpec(
            ("rollout",),
            "the predictions",
            recipe=Recipe(
                {"recordings": "recordings", "init": "init", "model": "model"}, defaults=_all_where_none_is_for_testing
            ),
        ),
        "model": InputSpec(
            MODELS, "Instead of rollouts: the model to roll out first.", choice=Choice.ANY_LINE, read=False
        ),
        "engine": InputSpec(("identify", "augment"), "engine to score as a rival", optional=True, choice=Choice.NAMED),
        "tracks": InputSpec(
            ("train",), "model whose training motions a rival replays", optional=True, choice=Choice.NAMED
        ),
        "measured": measured_input("tracks of the test episodes, to score a band", has_band),
    },
    run=run,
)
