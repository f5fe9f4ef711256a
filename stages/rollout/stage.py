"""rollout: predict unseen episodes from their first frame and the tool's motion, and render the prediction.

With `members`, models trained alike with other seeds, every prediction has a 90 % band: the spread of all models,
widened until it holds 90 % of the tracked points of the validation episodes, which no model was trained on.
"""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from plop.artifacts.layouts import Fits, Model
from plop.compute.device import chosen_device, jobs_on
from plop.dynamics.i2n.model_io import read_facts
from plop.errors import PlopError
from plop.models import load_model
from plop.pipeline.stage import Choice, Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.set import RecordingSet
from plop.render.rasterizer.rasterize import Backend
from plop.setting_kinds import ALL_CORES, AUTO_DEVICE, COMMON, Jobs, Range, Seed, Settings, Share, Split, Unit
from plop.uncertainty.band import Band
from stages import MODELS
from stages.common_inputs import init_input, measured_input, recordings_input
from stages.rollout.calibrate import calibrate, check_members, model_folders
from stages.rollout.episode import roll_out


@dataclass(frozen=True)
class RolloutConfig(Settings):
    """Settings of `rollout`; their defaults are defined only here."""

    split: Annotated[Split, COMMON] = "test"
    """Split of the episodes."""
    episodes: str = "*"
    """Only episodes whose name matches this pattern, e.g. "*_004"."""
    seed: Seed = 0
    """Seed of the model's random numbers (displacements of splits)."""
    device: Annotated[str, COMMON] = AUTO_DEVICE
    """Device of a learned model: "cpu", "cuda", "cuda:<number>", or "auto": cuda where there is one."""
    backend: Backend = "auto"
    """Renderer: "numba" (CPU), "gsplat" (CUDA), "torch" (slow reference) or "auto"."""
    video_camera: str = ""
    """Camera of the video; when empty, the one whose measured image changes most."""
    video_rate_hz: Annotated[float, Range(0, 1000), Unit("Hz")] = 0.0
    """Frames per second of the video; 0 plays in real time."""
    animation: bool = False
    """Write every frame as a splat PLY too, `animation/frame_<number>.ply`."""
    other_environment: bool = False
    """Roll out a model on an environment that it was not trained on."""
    min_inside: Share = 0.5
    """Smallest share of the fitted Gaussians inside frame 0's masks; below, the fit is of another object."""
    jobs: Annotated[Jobs, COMMON] = ALL_CORES
    """Number of parallel processes, one episode each; -1 is one per core. Sequential on a GPU."""


def run(inputs: Inputs, config: RolloutConfig, out: Output) -> Summary:
    """Write states, views, a video and a picture of it for each selected episode.

    Raises:
        PlopError: Nothing selected, an episode without a fit, a model or a fit of another object, states that are
            not finite.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    names = choose_episodes(recordings, config)
    init, folders = inputs["init"].path, model_folders(inputs)
    for name in names:
        Fits(init).episode(name).present(fix="Run `plop fit-init` on the same recordings, or choose other episodes.")
    if not config.other_environment:
        for folder in folders:
            _check_environment(folder, recordings.environment)
    band, warnings = (None, []) if len(folders) == 1 else calibrate(inputs, recordings, folders, config, out)
    work = partial(_roll_out, recordings, folders, init, config, band)
    done = out.map(names, work, jobs=jobs_on(config.device, config.jobs)).values.values()
    steps_ms = [ms for episode in done for ms in episode["steps_ms"]]
    figures = {
        "episodes": len(names),
        "step_ms_median": round(float(np.median(steps_ms)), 2),
        "step_ms_max": round(float(np.max(steps_ms)), 2),
        **({} if band is None else {"band_factor": round(band.factor, 3), "validation": len(band.validation)}),
    }
    return Summary(figures, [episode["row"] for episode in done], warnings)


def _roll_out(
    recordings: RecordingSet,
    folders: list[Path],
    init: Path,
    config: RolloutConfig,
    band: Band | None,
    name: str,
    out: Output,
) -> dict[str, Any]:
    models = [load_model(folder, chosen_device(config.device)) for folder in folders]
    row, steps_ms = roll_out(models, band, recordings, name, Fits(init).episode(name), config, out)
    return {"row": row, "steps_ms": steps_ms}


def _has_members(config: Any, inputs: Inputs) -> bool:
    return "members.0" in inputs


def choose_episodes(recordings: RecordingSet, config: RolloutConfig) -> list[str]:
    """Select episodes by split and pattern.

    Raises:
        PlopError: Nothing is left.
    """
    pool = recordings.names if config.split == "all" else getattr(recordings, config.split)
    names = [name for name in pool if fnmatchcase(name, config.episodes)]
    if not names:
        raise PlopError(
            "No episode is selected.",
            where=recordings.folder,
            expected=f"an episode of split {config.split} that matches {config.episodes}",
            found=", ".join(pool) or "no episode in this split",
            fix="Change rollout.split or rollout.episodes, or ingest with another split.",
        )
    return names


def _check_environment(model_folder: Path, environment: str) -> None:
    trained_on = read_facts(model_folder).get("training", {}).get("environment")
    if trained_on not in (None, environment):
        raise PlopError(
            "The model was trained on another object.",
            where=Model(model_folder).facts,
            expected=environment,
            found=str(trained_on),
            fix="Choose a model of this environment, or set rollout.other_environment.",
        )


STAGE = Stage(
    name="rollout",
    version=17,
    help="Predict unseen episodes from their first frame and actions.",
    config=RolloutConfig,
    inputs={
        "recordings": recordings_input("episodes: first frame, tool motion and cameras"),
        "init": init_input("Gaussians of object and tool at frame 0", choice=Choice.LATEST),
        "model": InputSpec(MODELS, "the dynamics model"),
        "members": InputSpec(
            ("train",),
            "models trained alike with other seeds: predictions have a 90 % band",
            optional=True,
            choice=Choice.NAMED,
            many=True,
        ),
        "measured": measured_input("tracks of the validation episodes, for the band", _has_members),
    },
    run=run,
    check_inputs=check_members,
)
