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
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Any, Literal

import numpy as np

from plop.artifacts.whole_file import write_json
from plop.checked_settings import check_jobs, check_ranges
from plop.determinism import deterministic
from plop.device import chosen_device
from plop.diagnosis.same_object import check_same_object
from plop.dynamics.cohesion import natural_strays_m
from plop.dynamics.features import FeatureSet
from plop.dynamics.filtering import UpdateConfig
from plop.dynamics.i2n import I2NConfig
from plop.dynamics.model import PlopConfig
from plop.dynamics.resampling import ResamplingConfig
from plop.dynamics.rest import RestPlaces
from plop.errors import PlopError
from plop.geometry.convex import convex_surface
from plop.geometry.extent import box_edges_m
from plop.models import FOLDS
from plop.physics.varied_motion import VariationRanges
from plop.recordings.set import RecordingSet
from plop.render.losses import RenderWeights
from plop.side_by_side import every_piece
from stages.contract import Inputs, InputSpec, Output, Stage, Summary
from stages.train.lessons import Lessons
from stages.train.made_up import MadeUp, MakingUp, engine_model, make_up
from stages.train.objective import LossWeights
from stages.train.optimise import Schedule, optimise
from stages.train.processes import Processes
from stages.train.tracks import Track, track_episode

_TRACK = "track-"
"""Beginning of a track's name among the finished pieces."""
_FRAMES_MEASURED = 5
"""Frames of a track, the first one too, that tell how closely its Gaussians keep together."""
_KEPT = 0.9
"""Share of the episodes that keep the bound of cohesion: a press bends more than a cut and is not to be held back."""


@dataclass(frozen=True)
class TrainConfig:
    """Settings of `train`; their defaults are written only here."""

    seed: int = 0
    """Seed of everything random."""
    track_steps: int = 700
    """Optimisation steps on the filter's tracks alone."""
    image_steps: int = 100
    """Optimisation steps after those, with the rendering loss."""
    batch: int = 2
    """Windows in a step, over all processes."""
    horizon: int = 4
    """Longest horizon of a window, in frames; the curriculum starts at 1 and doubles."""
    learning_rate: float = 3e-3
    """Largest learning rate of Adam; rises over the first tenth, then falls by a cosine."""
    averaging: float = 0.98
    """Decay of the averaged weights that are kept [-]."""
    noise_m: float = 0.001
    """Disturbance of a window's start [m]."""
    mirror: bool = True
    """See windows mirrored half of the time."""
    validate_every: int = 100
    """Steps between rollouts of the training episodes, from which the best weights are chosen."""
    checkpoint_every: int = 25
    """Steps between checkpoints."""
    kernel: Literal["paper", "quadratic", "cubic"] = "quadratic"
    """Kernel between particles and grid: 8, 27 or 64 nodes."""
    features: FeatureSet = "contact"
    """What a particle tells the network; "contact" adds place and motion relative to the tool, "oriented" also how the
    table's axes lie: for a table that rubs differently along x and y, as DiSECt's does."""
    frame: Literal["tool", "world"] = "tool"
    """Frame of the network: turns with the tool, or the world (the paper's)."""
    coupled: bool = True
    """A particle also takes a learned share of the tool's motion at its place; off in the paper."""
    cohesion: bool = True
    """In a rollout a Gaussian keeps to its neighbours on its side of the cut, as near as in the tracks; off in the
    paper."""
    cut_faces: bool = True
    """In a rollout a blade narrows the Gaussians that it passes, so that none reaches across the cut; off in the
    paper."""
    width: int = 24
    """Channels of particles and of the finest grid."""
    cells_across: float = 8.0
    """Grid cells along the object's longest extent."""
    resample: bool = True
    """Merge and split Gaussians."""
    merge_below: float = 0.05
    """Opacity under which a Gaussian merges into its neighbour [-]."""
    split_above: float = 20.0
    """Ratio of longest to shortest axis above which a Gaussian splits [-]; `fit-init` makes them up to 12."""
    resampling_form: Literal["moments", "paper"] = "moments"
    """Merging and splitting that keep the moments, or Eq. 27-28 as printed."""
    track_weight: float = 1.0
    """Weight of the distance to the track, per 0.1 m [-]."""
    image_weight: float = 1.0
    """Weight of the rendering loss in the second phase [-]."""
    rigid_weight: float = 1.0
    """Lambda_r of the rigidity term, per 0.1 m [-]."""
    rotation_weight: float = 0.05
    """Lambda_rot of the rotation term [-]."""
    isometry_weight: float = 1.0
    """Lambda_i of the isometry term, per 0.1 m [-]."""
    sever: bool = True
    """A blade severs neighbours in those terms; the paper keeps them."""
    ssim_weight: float = 0.1
    """Lambda_SSIM [-]."""
    l1_weight: float = 0.9
    """Lambda_L1 [-]."""
    depth_weight: float = 0.2
    """Lambda_depth, per `length_unit_m` [-]."""
    mask_weight: float = 0.1
    """Weight of the silhouette [-]; 0 in the paper."""
    length_unit_m: float = 0.1
    """Length that counts as 1 in the loss [m]; 1 in the paper, whose scenes have other units."""
    filter_iterations: int = 40
    """Gradient steps a frame of the filter that makes the tracks."""
    folds: int = 0
    """Models trained besides, each without its share of the episodes (2 or more; 0: none), so that `diagnose` can tell
    how far the model is off in episodes that it has not seen."""
    made_up: int = 24
    """Episodes that the engine makes up, where one is given."""
    made_up_reach: float = 1.6
    """Largest factor of the recorded ways along the table in made-up episodes; the smallest is 0.5 [-]."""
    made_up_speed: float = 1.4
    """Largest factor of the recorded speeds in made-up episodes; the smallest is its inverse [-]."""
    made_up_turn_deg: float = 20.0
    """Largest turn of a made-up motion about the vertical [degrees]."""
    device: str = "auto"
    """Where it runs: "cpu", "cuda", "cuda:<number>", or "auto": cuda where there is one."""
    jobs: int = field(default=-1, metadata={"in_fingerprint": False})
    """Tracks that are made at a time, made-up ones as well, each in a process; -1 is one a core. On a GPU one after
    the other."""


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
        PlopError: No training episode, one without fitted Gaussians, or an engine that is none or of another object.
    """
    _check(config)
    recordings = RecordingSet.load(inputs["recordings"].path)
    if "engine" in inputs:
        engine_model(inputs["engine"].path)
        check_same_object(inputs["engine"].path, recordings.environment, [],
                          fix="Give the engine that was fitted to these recordings.")  # fmt: skip
    if not recordings.train:
        raise PlopError("There is no episode to train on.", where=recordings.folder, expected="at least 1",
                        found=f"{len(recordings.test)} test episodes",
                        fix="Choose the test episodes with `plop ingest --test`.")  # fmt: skip
    if config.folds == 1 or config.folds > len(recordings.train):
        raise PlopError("The training episodes cannot be dealt out to so many folds.", where="train.folds",
                        expected=f"0, or 2 to {len(recordings.train)}", found=str(config.folds),
                        fix="Choose another number; each fold learns without its share of the episodes.")  # fmt: skip
    with Processes.join(chosen_device(config.device)) as processes:
        if processes.first:
            _make_tracks(recordings, inputs["init"].path, config, out)
            _make_up(recordings, inputs, config, out)
        processes.wait()
        return _train_on_tracks(recordings, inputs, config, out)


def _check(config: TrainConfig) -> None:
    weights = ("track", "image", "rigid", "rotation", "isometry", "ssim", "l1", "depth", "mask")
    check_jobs(config, "train")
    check_ranges(config, "train", {
        "track_steps": (0, inf), "image_steps": (0, inf), "batch": (1, inf), "horizon": (1, inf),
        "learning_rate": (0, 1), "averaging": (0, 1), "noise_m": (0, 1), "validate_every": (1, inf),
        "checkpoint_every": (1, inf), "width": (2, 4096), "cells_across": (1, 256), "merge_below": (0, 1),
        "folds": (0, inf), "made_up": (0, inf), "made_up_reach": (0, 10), "made_up_speed": (1, 10),
        "made_up_turn_deg": (0, 180), "split_above": (1, inf), "length_unit_m": (1e-6, inf),
        "filter_iterations": (0, inf), **{f"{name}_weight": (0, inf) for name in weights},
    })  # fmt: skip
    if config.track_steps + config.image_steps < 1:
        raise PlopError("There is nothing to train.", where="train.track_steps, train.image_steps",
                        expected="at least one step", found="0 and 0")  # fmt: skip


def _train_on_tracks(recordings: RecordingSet, inputs: Inputs, config: TrainConfig, out: Output) -> Summary:
    tracked = _make_tracks(recordings, inputs["init"].path, config, out)
    followed, warnings = _make_up(recordings, inputs, config, out)
    lessons = Lessons(recordings, out.path, chosen_device(config.device), list(recordings.train), followed)
    sizes = [_size_m(lessons.track(i)) for i in range(len(lessons.recorded))]
    about = {"environment": recordings.environment, "size_m": np.median(sizes, axis=0).tolist(),
             "made_up": len(followed)}  # fmt: skip
    for k in range(config.folds):
        _train_fold(k, lessons, config, out, about)
    model, chosen = train_on(lessons.track, len(lessons), config, out, about=about, judged=len(lessons.recorded))
    return Summary(figures={**tracked, **chosen, "train_episodes": len(recordings.train), "made_up_episodes":
                            len(followed), "motion_mm": model.motion_m * 1e3, "length_mm": model.length_m * 1e3,
                            **({} if model.stray_m is None else {"stray_mm": model.stray_m * 1e3})},
                   warnings=warnings)  # fmt: skip


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

    train_on(kept.track, len(kept), config, replace(out, path=folder, progress=progress), judged=len(kept.recorded),
             about={**about, "left_out": left_out})  # fmt: skip
    out.mark_done(piece)


def train_on(
    track: Callable[[int], Track], episodes: int, config: TrainConfig, out: Output, *, about: Mapping[str, Any],
    judged: int | None = None,
) -> tuple[PlopConfig, dict[str, float]]:  # fmt: skip
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
    model = _model_config(config, [track(i) for i in range(episodes)])
    plan = Schedule(
        track_steps=config.track_steps, image_steps=config.image_steps, batch=config.batch, horizon=config.horizon,
        learning_rate=config.learning_rate, averaging=config.averaging, noise_m=config.noise_m, mirror=config.mirror,
        validate_every=config.validate_every, checkpoint_every=config.checkpoint_every, seed=config.seed,
    )  # fmt: skip
    chosen = optimise(model, track, episodes, plan, _loss_weights(config, _render_weights(config)), out,
                      judged=judged, about=about, device=chosen_device(config.device))  # fmt: skip
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
        raise PlopError("An episode has no fitted Gaussians.", where=splat, expected="object.ply of `plop fit-init`",
                        found="no file", fix="Run `plop fit-init` on the same recordings.")  # fmt: skip
    update = UpdateConfig(iterations=config.filter_iterations, weights=_render_weights(config))
    error = track_episode(recordings.path(name), splat, out.path / "tracks" / f"{name}.h5", update,
                          lambda done, frames: out.progress(done, frames, f"track {name}"),
                          chosen_device(config.device))  # fmt: skip
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


def _model_config(config: TrainConfig, tracks: list[Track]) -> PlopConfig:
    """Measure the units of the model's inputs and outputs on the training set."""
    length = max(float((t.means[0].amax(0) - t.means[0].amin(0)).max()) for t in tracks)
    square = sum(float(t.means.diff(dim=0).square().sum(-1).mean()) for t in tracks) / len(tracks)
    return PlopConfig(
        network=I2NConfig(config.kernel, config.features, config.width, config.cells_across),
        resampling=ResamplingConfig(config.resample, config.merge_below, config.split_above, config.resampling_form),
        frame=config.frame,
        coupled=config.coupled,
        length_m=length,
        motion_m=max(square**0.5, 1e-5),
        stray_m=_stray_m(tracks) if config.cohesion else None,
        cut_faces=config.cut_faces,
    )


def _stray_m(tracks: list[Track]) -> float:
    """Measure how far Gaussians lie from where their neighbours put them [m].

    Nine episodes of ten keep it. Where an engine made some up, those alone count: the others hold the filter's noise.
    """
    episodes = {track.name: track for track in tracks}.values()
    found = []
    for track in [track for track in episodes if track.recording_path is None] or episodes:
        frames = np.unique(np.linspace(0, len(track) - 1, _FRAMES_MEASURED).round().astype(int))[1:]
        found.append(natural_strays_m(RestPlaces(track.means[0]), track.means[frames], track.sides[frames]))
    return float(np.quantile(found, _KEPT))


def _render_weights(config: TrainConfig) -> RenderWeights:
    return RenderWeights(
        config.ssim_weight, config.l1_weight, config.depth_weight, config.mask_weight, config.length_unit_m
    )


def _loss_weights(config: TrainConfig, render: RenderWeights) -> LossWeights:
    return LossWeights(
        track=config.track_weight, image=config.image_weight, rigid=config.rigid_weight,
        rotation=config.rotation_weight, isometry=config.isometry_weight, sever=config.sever, render=render,
    )  # fmt: skip


STAGE = Stage(
    name="train",
    version=10,
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
)
