"""train: learn the dynamics of an object from its training episodes (PLOP, Sec. III-D).

1. Track the object through every training episode with the filter (tracks).
2. Optimise the model: first on the tracks only, then with the rendering loss, with growing horizons.
3. Keep the averaged weights with the smallest rollout error on the training episodes.

The paper's form has no tracks: epochs over whole episodes, from their fitted Gaussians, on images alone.

With an engine, simulated episodes are used as well (`stages.train.simulated_episodes`).

With `folds`, further models are trained first, each without its share of the episodes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Fits, Model
from plop.artifacts.lineage import recordings_content
from plop.compute.determinism import deterministic
from plop.compute.device import chosen_device, jobs_on
from plop.dynamics.learned import LearnedConfig
from plop.dynamics.peers.model import PeerConfig
from plop.errors import PlopError
from plop.geometry.meshes.convex import convex_surface
from plop.geometry.meshes.extent import box_edges_m
from plop.models import seen_by
from plop.pipeline.stage import Choice, Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.set import RecordingSet
from plop.tracking.same_object import check_same_object
from stages.common_inputs import init_input, recordings_input
from stages.train.form import model_config, scene_scale
from stages.train.optimise import optimise
from stages.train.processes import Processes
from stages.train.settings import TrainConfig
from stages.train.simulated_episodes import SimulatedEpisode, engine_model, simulate_episodes
from stages.train.tracks import Track, track_episode, write_start
from stages.train.training_set import TrainingSet


@deterministic()
def run(inputs: Inputs, config: TrainConfig, out: Output) -> Summary:
    """Train a model on the training episodes of a recording set.

    Args:
        inputs: "recordings", "init" (fitted Gaussians of frame 0) and, optionally, the "engine" for simulated episodes.
        config: Settings.
        out: Receives model.safetensors, model.json, log.jsonl, tensorboard/, tracks/ and made-up/; folds/<k>/ with the
            same except the tracks.

    Returns:
        Figures of the tracks and of the chosen weights.

    Raises:
        PlopError: No training episode, one without fitted Gaussians, or an engine that is not one, of another object,
            or fitted to test episodes.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    if "engine" in inputs:
        engine_model(inputs["engine"].path)
        _check_engine_is_clean(inputs["engine"].path, recordings, recordings_content(inputs["recordings"].manifest))
        check_same_object(
            inputs["engine"].path, recordings.environment, [], fix="Use the engine that was fitted to these recordings."
        )
    if not recordings.train:
        raise PlopError(
            "There is no episode to train on.",
            where=recordings.folder,
            expected="at least 1",
            found=f"{len(recordings.test)} test episodes",
            fix="Choose fewer test episodes when ingesting or simulating these recordings: --test.",
        )
    if config.folds > len(recordings.train):
        raise PlopError(
            "There are too few training episodes for this number of folds.",
            where="train.folds",
            expected=f"0, or 2 to {len(recordings.train)}",
            found=str(config.folds),
            fix="Choose another number; each fold is trained without its share of the episodes.",
        )
    if config.validation >= len(recordings.train):
        raise PlopError(
            "No episode is left to train on.",
            where="train.validation",
            expected=f"less than {len(recordings.train)}, the number of training episodes",
            found=str(config.validation),
            fix="Set it to a smaller number.",
        )
    with Processes.join(chosen_device(config.device)) as processes:
        if processes.first:
            _make_tracks(recordings, inputs["init"].path, config, out)
            _make_up(recordings, inputs, config, out)
        processes.wait()
        return _train_on_tracks(recordings, inputs, config, out)


def _check_engine_is_clean(engine: Path, recordings: RecordingSet, content: list[str]) -> None:
    """Reject an engine that, or an effect of which, was fitted to test episodes: the network would learn from them.

    Raises:
        PlopError: It was; explains how to fit a valid one.
    """
    seen = seen_by(engine, recordings.test, content)
    if seen:
        raise PlopError(
            "The engine was fitted to test episodes.",
            where=Model(engine).facts,
            expected="an engine fitted to training episodes only",
            found=", ".join(seen),
            fix="Fit one to them: `plop identify --split train --name clean`, then `plop train --engine clean`.",
        )


def _train_on_tracks(recordings: RecordingSet, inputs: Inputs, config: TrainConfig, out: Output) -> Summary:
    tracked = _make_tracks(recordings, inputs["init"].path, config, out)
    followed, warnings = _make_up(recordings, inputs, config, out)
    scale = scene_scale(inputs["init"].path, recordings.train)
    if scale is not None:
        config = replace(config, render=config.render.in_scene_units(scale))
    training_set = TrainingSet(
        recordings, out.path, chosen_device(config.device), list(recordings.train), followed, 1 / (scale or 1.0)
    )
    judges = training_set
    if config.validation:
        left_out = training_set.recorded[-config.validation :]
        judges = replace(training_set, recorded=left_out, made_up=[])
        training_set = training_set.without(left_out)
    sizes = [_size_m(training_set.track(i)) for i in range(len(training_set.recorded))]
    about = {
        "environment": recordings.environment,
        "size_m": np.median(sizes, axis=0).tolist(),
        "made_up": len(followed),
        **({"validation": judges.recorded} if config.validation else {}),
        **({} if scale is None else {"scene_scale": scale}),
    }
    for k in range(config.folds):
        _train_fold(k, training_set, config, out, about)
    model, chosen = train_on(
        training_set.track, len(training_set), config, out, about=about, judged=len(judges.recorded), judge=judges.track
    )
    return Summary(
        figures={
            **tracked,
            **chosen,
            "train_episodes": len(recordings.train),
            "made_up_episodes": len(followed),
            "motion_mm": model.motion_m * 1e3,
            "length_mm": model.length_m * 1e3,
            **({} if isinstance(model, PeerConfig) or model.stray_m is None else {"stray_mm": model.stray_m * 1e3}),
            **({} if scale is None else {"scene_scale": scale}),
        },
        warnings=warnings,
    )


def _train_fold(k: int, training_set: TrainingSet, config: TrainConfig, out: Output, about: Mapping[str, Any]) -> None:
    """Train a model without every `folds`-th episode, once; model.json names these (`plop.models.judges_of`)."""
    piece, left_out = f"fold-{k}", training_set.recorded[k :: config.folds]
    if out.is_done(piece):
        return
    kept = training_set.without(left_out)
    folder = Model(out.path).folds / str(k)
    folder.mkdir(parents=True, exist_ok=True)

    def progress(done: float, total: float, label: str = "", **figures: Any) -> None:
        out.progress(done, total, f"fold {k + 1} of {config.folds}: {label}", **figures)

    train_on(
        kept.track,
        len(kept),
        config,
        replace(out, path=folder, progress=progress),
        judged=len(kept.recorded),
        about={**about, "left_out": left_out},
    )
    out.mark_done(piece)


def train_on(
    track: Callable[[int], Track],
    episodes: int,
    config: TrainConfig,
    out: Output,
    *,
    about: Mapping[str, Any],
    judged: int | None = None,
    judge: Callable[[int], Track] | None = None,
) -> tuple[LearnedConfig, dict[str, float]]:
    """Optimise a model on tracks.

    Args:
        track: Returns the track of an episode by its number, on the configured device.
        episodes: Number of tracks.
        config: Settings.
        out: Receives model.safetensors, model.json, log.jsonl and tensorboard/.
        about: Facts about the modelled object; stored with the weights.
        judged: Number of first episodes whose rollouts select the weights; all when absent.
        judge: Returns these episodes by number; those of training when absent.

    Returns:
        The model's configuration and units, and the figures of the chosen weights.
    """
    model = model_config(config, [track(i) for i in range(episodes)])
    chosen = optimise(
        model,
        track,
        episodes,
        config,
        out,
        judged=judged,
        judge=judge,
        about=about,
        device=chosen_device(config.device),
    )
    return model, chosen


def _size_m(track: Track) -> np.ndarray:
    """Size of the object at the first frame, [3] [m]."""
    return box_edges_m(*convex_surface(track.means[0].double().cpu().numpy(), track.actions.table_z_m))


def _make_tracks(recordings: RecordingSet, init: Path, config: TrainConfig, out: Output) -> dict[str, float]:
    """Track the object through the training episodes that have no track yet; return the tracks' mean errors."""
    work = partial(_make_track, recordings, init, config)
    done = out.map(recordings.train, work, jobs=jobs_on(config.device, config.jobs), of="track")
    errors = done.values.values()
    named = ("depth_mm", "l1") if config.follows_tracks else ()
    return {f"track_{key}": sum(e[key] for e in errors) / len(errors) for key in named}


@deterministic()
def _make_track(recordings: RecordingSet, init: Path, config: TrainConfig, name: str, out: Output) -> dict[str, float]:
    splat = Fits(init).episode(name).present(tool=False).object_splat
    if not config.follows_tracks:
        write_start(splat, Model(out.path).tracks.states(name))
        return {}
    error = track_episode(
        recordings.path(name),
        splat,
        Model(out.path).tracks.states(name),
        config.update,
        lambda done, frames: out.progress(done, frames, f"track {name}"),
        chosen_device(config.device),
        weights=config.render,
    )
    write_json(Model(out.path).tracks.innovation(name), error)
    return error


def _make_up(
    recordings: RecordingSet, inputs: Inputs, config: TrainConfig, out: Output
) -> tuple[list[SimulatedEpisode], list[str]]:
    """Simulate episodes with the engine, if there is one; return the successful ones, and a warning of failures."""
    if "engine" not in inputs:
        return [], []
    return simulate_episodes(recordings, inputs["init"].path, inputs["engine"].path, config, out)


STAGE = Stage(
    name="train",
    version=16,
    help="Learn the dynamics from the training episodes.",
    config=TrainConfig,
    inputs={
        "recordings": recordings_input("Recordings; only training episodes are used."),
        "init": init_input("Gaussians of frame 0.", choice=Choice.LATEST),
        "engine": InputSpec(
            ("identify", "augment"), "Engine for simulated training episodes.", optional=True, choice=Choice.NAMED
        ),
    },
    run=run,
)
