"""train: learn the dynamics of an object from its training episodes (PLOP, Sec. III-D).

1. Follow the object through every training episode with the filter (tracks).
2. Optimise the model: first on the tracks alone, then with the rendering loss, horizons growing.
3. Keep the averaged weights that roll out the training episodes best.

With an engine, episodes that it makes up are learned from, too (`stages.train.made_up`).

With `folds`, further models are trained first, each without its share of the episodes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from plop.artifacts.atomic_file import write_json
from plop.artifacts.lineage import recordings_content
from plop.compute.determinism import deterministic
from plop.compute.device import chosen_device
from plop.dynamics.filtering import UpdateConfig
from plop.dynamics.model import PlopConfig
from plop.errors import PlopError
from plop.geometry.convex import convex_surface
from plop.geometry.extent import box_edges_m
from plop.models import FOLDS, seen_by
from plop.physics.scenes.varied_motion import VariationRanges
from plop.pipeline.parallel import every_piece
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary, settings_only
from plop.recordings.set import RecordingSet
from plop.tracking.same_object import check_same_object
from stages.train.form import loss_weights, model_config, render_weights
from stages.train.lessons import Lessons
from stages.train.made_up import MadeUp, MakingUp, engine_model, make_up
from stages.train.optimise import Schedule, optimise
from stages.train.processes import Processes
from stages.train.settings import TrainConfig, check_settings
from stages.train.tracks import Track, track_episode

_TRACK = "track-"
"""Beginning of a track's name among the finished pieces."""


@deterministic()
def run(inputs: Inputs, config: TrainConfig, out: Output) -> Summary:
    """Train a model on the training episodes of a recording set.

    Args:
        inputs: "recordings", "init" (fitted Gaussians of frame 0) and, if wanted, the "engine" that makes up episodes.
        config: Settings.
        out: Receives model.safetensors, model.json, log.jsonl, tensorboard/, tracks/ and made-up/; folds/<k>/ with the
            same but for the tracks.

    Returns:
        Figures of the tracks and of the chosen weights.

    Raises:
        PlopError: No training episode, one without fitted Gaussians, or an engine that is none, of another object, or
            fitted to test episodes.
    """
    check_settings(config)
    recordings = RecordingSet.load(inputs["recordings"].path)
    if "engine" in inputs:
        engine_model(inputs["engine"].path)
        _check_engine_is_clean(inputs["engine"].path, recordings, recordings_content(inputs["recordings"].manifest))
        check_same_object(
            inputs["engine"].path,
            recordings.environment,
            [],
            fix="Give the engine that was fitted to these recordings.",
        )
    if not recordings.train:
        raise PlopError(
            "There is no episode to train on.",
            where=recordings.folder,
            expected="at least 1",
            found=f"{len(recordings.test)} test episodes",
            fix="Choose fewer test episodes where these recordings are made: --test.",
        )
    if config.folds == 1 or config.folds > len(recordings.train):
        raise PlopError(
            "The training episodes cannot be dealt out to so many folds.",
            where="train.folds",
            expected=f"0, or 2 to {len(recordings.train)}",
            found=str(config.folds),
            fix="Choose another number; each fold learns without its share of the episodes.",
        )
    with Processes.join(chosen_device(config.device)) as processes:
        if processes.first:
            _make_tracks(recordings, inputs["init"].path, config, out)
            _make_up(recordings, inputs, config, out)
        processes.wait()
        return _train_on_tracks(recordings, inputs, config, out)


def _check_engine_is_clean(engine: Path, recordings: RecordingSet, content: list[str]) -> None:
    """Refuse an engine that was fitted to test episodes, or has an effect that was: the network would learn from them.

    Raises:
        PlopError: It was; says how to fit one that was not.
    """
    seen = seen_by(engine, recordings.test, content)
    if seen:
        raise PlopError(
            "The engine was fitted to episodes that are for testing.",
            where=engine / "model.json",
            expected="an engine fitted to training episodes only",
            found=", ".join(seen),
            fix="Fit one to them: `plop identify --split train --name clean`, then `plop train --engine clean`.",
        )


def _train_on_tracks(recordings: RecordingSet, inputs: Inputs, config: TrainConfig, out: Output) -> Summary:
    tracked = _make_tracks(recordings, inputs["init"].path, config, out)
    followed, warnings = _make_up(recordings, inputs, config, out)
    lessons = Lessons(recordings, out.path, chosen_device(config.device), list(recordings.train), followed)
    sizes = [_size_m(lessons.track(i)) for i in range(len(lessons.recorded))]
    about = {
        "environment": recordings.environment,
        "size_m": np.median(sizes, axis=0).tolist(),
        "made_up": len(followed),
    }
    for k in range(config.folds):
        _train_fold(k, lessons, config, out, about)
    model, chosen = train_on(lessons.track, len(lessons), config, out, about=about, judged=len(lessons.recorded))
    return Summary(
        figures={
            **tracked,
            **chosen,
            "train_episodes": len(recordings.train),
            "made_up_episodes": len(followed),
            "motion_mm": model.motion_m * 1e3,
            "length_mm": model.length_m * 1e3,
            **({} if model.stray_m is None else {"stray_mm": model.stray_m * 1e3}),
        },
        warnings=warnings,
    )


def _train_fold(k: int, lessons: Lessons, config: TrainConfig, out: Output, about: Mapping[str, Any]) -> None:
    """Train a model without every `folds`-th episode, once; its model.json tells which (`plop.models.judges_of`)."""
    piece, left_out = f"fold-{k}", lessons.recorded[k :: config.folds]
    if out.is_done(piece):
        return
    kept = lessons.without(left_out)
    folder = out.path / FOLDS / str(k)
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
) -> tuple[PlopConfig, dict[str, float]]:
    """Optimise a model on tracks.

    Args:
        track: Gives the track of an episode by its number, on the configured device.
        episodes: Number of tracks.
        config: Settings.
        out: Receives model.safetensors, model.json, log.jsonl and tensorboard/.
        about: What the model is a model of; kept beside the weights.
        judged: Episodes from the first on whose rollouts choose the weights; all when absent.

    Returns:
        The model's form and units, and the figures of the chosen weights.
    """
    model = model_config(config, [track(i) for i in range(episodes)])
    plan = Schedule(
        track_steps=config.track_steps,
        image_steps=config.image_steps,
        batch=config.batch,
        horizon=config.horizon,
        learning_rate=config.learning_rate,
        averaging=config.averaging,
        noise_m=config.noise_m,
        mirror=config.mirror,
        validate_every=config.validate_every,
        checkpoint_every=config.checkpoint_every,
        seed=config.seed,
    )
    chosen = optimise(
        model,
        track,
        episodes,
        plan,
        loss_weights(config),
        out,
        judged=judged,
        about=about,
        device=chosen_device(config.device),
    )
    return model, chosen


def _size_m(track: Track) -> np.ndarray:
    """Size of the object at the first frame, [3] [m]."""
    return box_edges_m(*convex_surface(track.means[0].double().cpu().numpy(), track.actions.table_z_m))


def _make_tracks(recordings: RecordingSet, init: Path, config: TrainConfig, out: Output) -> dict[str, float]:
    """Follow the object through the training episodes that have no track yet; gives the tracks' mean errors."""
    folder = out.path / "tracks"
    folder.mkdir(exist_ok=True)
    pieces = [_TRACK + name for name in recordings.train]
    jobs = config.jobs if chosen_device(config.device).type == "cpu" else 1
    every_piece(partial(_make_track, recordings, init, config), pieces, out, jobs=jobs)
    errors = [json.loads((folder / f"{name}.json").read_text()) for name in recordings.train]
    return {f"track_{key}": sum(e[key] for e in errors) / len(errors) for key in ("depth_mm", "l1")}


@deterministic()
def _make_track(recordings: RecordingSet, init: Path, config: TrainConfig, piece: str, out: Output) -> None:
    name = piece.removeprefix(_TRACK)
    splat = init / name / "object.ply"
    if not splat.is_file():
        raise PlopError(
            "An episode has no fitted Gaussians.",
            where=splat,
            expected="object.ply of `plop fit-init`",
            found="no file",
            fix="Run `plop fit-init` on the same recordings.",
        )
    update = UpdateConfig(iterations=config.filter_iterations, weights=render_weights(config))
    error = track_episode(
        recordings.path(name),
        splat,
        out.path / "tracks" / f"{name}.h5",
        update,
        lambda done, frames: out.progress(done, frames, f"track {name}"),
        chosen_device(config.device),
    )
    write_json(out.path / "tracks" / f"{name}.json", error)


def _make_up(
    recordings: RecordingSet, inputs: Inputs, config: TrainConfig, out: Output
) -> tuple[list[MadeUp], list[str]]:
    """Let the engine make up episodes, where there is one; gives those that it followed, and a warning of others."""
    if "engine" not in inputs:
        return [], []
    ranges = VariationRanges(config.made_up_reach, config.made_up_speed, config.made_up_turn_deg)
    paths = inputs["init"].path, inputs["engine"].path
    return make_up(recordings, *paths, MakingUp(config.made_up, ranges, config.seed, config.jobs), out)


STAGE = Stage(
    name="train",
    version=11,
    help="Learn the dynamics from the training episodes.",
    config=TrainConfig,
    inputs={
        "recordings": InputSpec(("calibrate", "ingest", "simulate"), "Recordings; only training episodes are opened."),
        "init": InputSpec(("fit-init",), "Gaussians of frame 0."),
        "engine": InputSpec(
            ("identify", "augment"), "Engine that makes up episodes to learn from, too.", optional=True, only_named=True
        ),
    },
    run=run,
    check=settings_only(check_settings),
)
