"""rollout: predict unseen episodes from their first frame and the tool's motion, and render the prediction."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from plop.checked_settings import check_choices, check_ranges
from plop.compute.device import chosen_device
from plop.dynamics.model_io import read_facts
from plop.errors import PlopError
from plop.models import load_model
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary, settings_only
from plop.recordings.set import RecordingSet
from plop.render.rasterize import BACKENDS
from stages.rollout.episode import roll_out

SPLITS = ("test", "train", "all")


@dataclass(frozen=True)
class RolloutConfig:
    """Settings of `rollout`; their defaults are written only here."""

    split: str = "test"
    """Which episodes: "test", "train" or "all"."""
    episodes: str = "*"
    """Only episodes whose name matches this pattern, e.g. "*_004"."""
    seed: int = 0
    """Seed of whatever the model draws (the displacement of a split)."""
    device: str = "auto"
    """Where a learned model runs: "cpu", "cuda", "cuda:<number>", or "auto": cuda where there is one."""
    backend: str = "auto"
    """Renderer: "numba" (CPU), "gsplat" (CUDA), "torch" (slow reference) or "auto"."""
    video_camera: str = ""
    """Camera of the video; when empty, the one whose measured image changes most."""
    video_rate_hz: float = 0.0
    """Frames per second of the video [Hz]; 0 keeps the recording's time."""
    animation: bool = False
    """Write every frame as a splat PLY too, `animation/frame_<number>.ply`."""
    other_environment: bool = False
    """Roll out a model on an environment that it was not trained on."""
    min_inside: float = 0.5
    """Least part of the fitted Gaussians inside frame 0's masks; below, the fit is of another object."""


def run(inputs: Inputs, config: RolloutConfig, out: Output) -> Summary:
    """Write states, views, a video and a still of it for each chosen episode.

    Raises:
        PlopError: Nothing chosen, an episode without a fit, a model or a fit of another object, states that are
            not finite.
    """
    _check(config)
    recordings = RecordingSet.load(inputs["recordings"].path)
    names = choose_episodes(recordings, config)
    init, model_folder = inputs["init"].path, inputs["model"].path
    for name in names:
        _check_init(init / name, name)
    if not config.other_environment:
        _check_environment(model_folder, recordings.environment)
    model = load_model(model_folder, chosen_device(config.device))
    table: list[dict] = []
    steps_ms: list[float] = []
    for done, name in enumerate(names):
        if not out.is_done(name):
            row, times = roll_out(model, recordings, name, init / name, config, out)
            table.append(row)
            steps_ms += times
            out.mark_done(name)
        out.progress(done + 1, len(names), name)
    figures: dict[str, float] = {"episodes": len(names), "episodes_of_this_run": len(table)}
    if steps_ms:
        figures["step_ms_median"] = round(float(np.median(steps_ms)), 2)
        figures["step_ms_max"] = round(float(np.max(steps_ms)), 2)
    return Summary(figures, table)


def _check(config: RolloutConfig) -> None:
    check_choices(config, "rollout", {"split": SPLITS, "backend": BACKENDS})
    check_ranges(config, "rollout", {"video_rate_hz": (0, 1000), "min_inside": (0, 1)})


def choose_episodes(recordings: RecordingSet, config: RolloutConfig) -> list[str]:
    """Pick episodes by split and pattern.

    Raises:
        PlopError: Nothing is left.
    """
    pool = recordings.names if config.split == "all" else getattr(recordings, config.split)
    names = [name for name in pool if fnmatchcase(name, config.episodes)]
    if not names:
        raise PlopError(
            "No episode is chosen.",
            where=recordings.folder,
            expected=f"an episode of split {config.split} that matches {config.episodes}",
            found=", ".join(pool) or "no episode in this split",
            fix="Change rollout.split or rollout.episodes, or ingest with another split.",
        )
    return names


def _check_init(folder: Path, name: str) -> None:
    for part in ("object.ply", "tool.ply"):
        if not (folder / part).is_file():
            raise PlopError(
                "An episode has no fitted Gaussians.",
                where=folder / part,
                expected=f"a fit of {name}",
                found="no file",
                fix="Run `plop fit-init` on the same recordings, or choose other episodes.",
            )


def _check_environment(model_folder: Path, environment: str) -> None:
    trained_on = read_facts(model_folder).get("training", {}).get("environment")
    if trained_on not in (None, environment):
        raise PlopError(
            "The model was trained on another object.",
            where=model_folder / "model.json",
            expected=environment,
            found=str(trained_on),
            fix="Choose a model of this environment, or set rollout.other_environment.",
        )


STAGE = Stage(
    name="rollout",
    version=11,
    help="Predict unseen episodes from their first frame and actions.",
    config=RolloutConfig,
    inputs={
        "recordings": InputSpec(("calibrate", "ingest", "simulate"), "episodes: first frame, tool motion and cameras"),
        "init": InputSpec(("fit-init",), "Gaussians of object and tool at frame 0"),
        "model": InputSpec(("train", "identify", "augment"), "the dynamics model"),
    },
    run=run,
    check=settings_only(_check),
)
