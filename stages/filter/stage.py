"""filter: track the object through an episode with a model (PLOP, Sec. III-C).

Each frame is predicted, then updated on the measured images. Both states are stored, with their
difference (where the model is wrong) and the innovation per camera (how wrong, before the update).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch

from plop.artifacts.atomic_file import write_text
from plop.artifacts.layouts import Fits, Tracks
from plop.compute.determinism import deterministic
from plop.compute.device import chosen_device, jobs_on
from plop.dynamics.baselines import ConstantVelocity
from plop.dynamics.episodes import measured_views
from plop.dynamics.filter.particle_filter import FilterStep, UpdateConfig, run_filter, settled
from plop.dynamics.interface import DynamicsModel, at_rest
from plop.gaussians.splat_ply import read_splat
from plop.gaussians.trajectory import TrajectoryWriter
from plop.models import device_of, load_model
from plop.pipeline.stage import Choice, Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.excluded import check_excluded
from plop.recordings.set import RecordingSet
from plop.render.losses import RenderWeights
from plop.setting_kinds import ALL_CORES, AUTO_DEVICE, COMMON, Jobs, Range, Seed, Settings, Split, Unit
from stages import MODELS
from stages.common_inputs import init_input, recordings_input


@dataclass(frozen=True)
class FilterConfig(Settings):
    """Settings of `filter`; their defaults are defined only here."""

    seed: Annotated[Seed, COMMON] = 0
    """Seed of the splits."""
    split: Annotated[Split, COMMON] = "all"
    """Episodes to filter."""
    update: UpdateConfig = UpdateConfig()
    """How each frame is updated on its images."""
    render: RenderWeights = RenderWeights(depth=0.6)
    """Weights of the rendering loss in an update."""
    settle: Annotated[int, Range(0), Unit("updates")] = 2
    """Updates of the first frame on its own views."""
    exclude: Annotated[tuple[str, ...], COMMON] = ()
    """Cameras that are not used, e.g. a faulty one."""
    device: Annotated[str, COMMON] = AUTO_DEVICE
    """Device: "cpu", "cuda", "cuda:<number>", or "auto": cuda where there is one."""
    jobs: Annotated[Jobs, COMMON] = ALL_CORES
    """Number of parallel processes, one episode each; -1 is one per core. Sequential on a GPU."""


def run(inputs: Inputs, config: FilterConfig, out: Output) -> Summary:
    """Filter the chosen episodes.

    Args:
        inputs: "recordings", "init" and, optionally, "model"; without it constant velocity predicts.
        config: Settings.
        out: Receives <episode>.h5 (groups predicted and updated; extra arrays last_translation,
            last_rotation, side and, beside updated, update [N, 3] in metres) and <episode>.json (innovation).

    Returns:
        Mean innovation before and after the update, per episode.

    Raises:
        PlopError: The split or an excluded camera is unknown, none is left, or an episode has no fitted Gaussians.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    check_excluded(recordings, config.exclude, "filter")
    chosen = {"train": recordings.train, "test": recordings.test, "all": recordings.names}[config.split]
    model = inputs["model"].path if "model" in inputs else None
    work = partial(_filter_episode, recordings, inputs["init"].path, model, config)
    rows = list(out.map(chosen, work, jobs=jobs_on(config.device, config.jobs)).values.values())
    figures = {key: float(np.mean([row[key] for row in rows])) for key in rows[0] if key != "episode"} if rows else {}
    return Summary(figures={"episodes": len(rows), **figures}, table=rows)


@deterministic()
def _filter_episode(
    recordings: RecordingSet, init: Path, model_folder: Path | None, config: FilterConfig, name: str, out: Output
) -> dict[str, Any]:
    """Filter one episode; return its mean innovation."""
    splat = Fits(init).episode(name).present(tool=False).object_splat
    device = chosen_device(config.device)
    model: DynamicsModel = ConstantVelocity()
    if model_folder is not None:
        model = load_model(model_folder, device)
        device = device_of(model)
    generator = torch.Generator("cpu").manual_seed(config.seed)
    frames = []
    with recordings.open(name) as recording, TrajectoryWriter(Tracks(out.path).states(name)) as writer:
        cameras = [camera for camera in recording.camera_names if camera not in config.exclude]
        views = measured_views(recording, 0, cameras, device)
        first = settled(read_splat(splat).to(device), views, config.update, config.settle, config.render)
        writer.append("updated", 0, first, side=at_rest(first).side)
        steps = run_filter(
            model, recording, first, config.update, weights=config.render, cameras=cameras, generator=generator
        )
        for step in steps:
            _store(writer, step)
            frames.append(
                {"frame": step.frame, "time_s": float(recording.time_s[step.frame]), "cameras": step.innovation}
            )
            out.progress(step.frame + 1, len(recording), name, gaussians=len(step.updated.side))
    innovation = {"episode": name, "units": "l1: colour 0..1; depth: mm", "frames": frames}
    write_text(Tracks(out.path).innovation(name), json.dumps(innovation))
    return {"episode": name, **_means(frames)}


def _store(writer: TrajectoryWriter, step: FilterStep) -> None:
    for group, state in (("predicted", step.predicted), ("updated", step.updated)):
        extra = {"last_translation": state.last_translation, "last_rotation": state.last_rotation, "side": state.side}
        if group == "updated":
            extra["update"] = state.gaussians.means - step.predicted.gaussians.means
        writer.append(group, step.frame, state.gaussians, **extra)


def _means(frames: list[dict[str, Any]]) -> dict[str, float]:
    """Average the innovation over frames and cameras."""
    cells = [row for frame in frames for row in frame["cameras"].values()]
    names = ("l1", "depth_mm", "updated_l1", "updated_depth_mm")
    return {name: float(np.mean([cell[name] for cell in cells])) if cells else float("nan") for name in names}


STAGE = Stage(
    name="filter",
    version=11,
    help="Track the object through an episode: predict and update.",
    config=FilterConfig,
    inputs={
        "recordings": recordings_input("Recordings."),
        "init": init_input("Gaussians of frame 0.", choice=Choice.LATEST),
        "model": InputSpec(MODELS, "Model for the prediction; constant velocity by default.", optional=True),
    },
    run=run,
)
