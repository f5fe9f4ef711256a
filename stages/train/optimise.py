"""The optimisation: horizon curriculum, averaged weights, checkpoints, several processes.

Under `torchrun` each process has its share of every batch and PyTorch averages the gradients;
only the first process writes. The windows of a step depend on seed and step only, so the loss of
several processes is that of one on the same batch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from plop.artifacts.layouts import Model
from plop.dynamics.i2n.model_io import save_model
from plop.dynamics.interface import at_rest
from plop.dynamics.learned import LearnedConfig, LearnedModel, untrained
from plop.pipeline.stage import Output
from plop.render.losses import RenderWeights
from stages.train.checkpoints import Progressed, load_checkpoint, save_checkpoint
from stages.train.journal import Journal
from stages.train.objective import TrainingStep, image_loss
from stages.train.processes import Processes, share
from stages.train.settings import TrainConfig
from stages.train.tracks import Track
from stages.train.windows import draw_windows, whole_episodes


def optimise(
    config: LearnedConfig,
    track: Callable[[int], Track],
    episodes: int,
    plan: TrainConfig,
    out: Output,
    *,
    judged: int | None = None,
    judge: Callable[[int], Track] | None = None,
    about: Mapping[str, Any] | None = None,
    device: torch.device | str = "cpu",
) -> dict[str, float]:
    """Train a model and write the weights with the smallest rollout error: to the tracks, or of the images without any.

    Args:
        config: The model's configuration and units.
        track: Returns the track of an episode by its number.
        episodes: Number of training episodes.
        plan: Schedule, and weights of the loss.
        out: Output; training resumes from a checkpoint found there.
        judged: Number of first episodes whose rollouts select the weights; all when absent.
        judge: Returns these episodes by number; those of training when absent.
        about: Facts about the modelled object; stored with the weights.
        device: Device of the training, and of the tracks that `track` returns.

    Returns:
        {"best_step", and "rollout_error_mm" or "rollout_image_loss"} of the chosen weights, {"loss"} of the last step.
    """
    plan = plan.counted(episodes)
    score = _Score(judge or track, judged or episodes, plan)
    torch.manual_seed(plan.seed)
    with Processes.join(device) as processes:
        model = untrained(config).to(device)
        optimiser = torch.optim.AdamW(model.parameters(), lr=plan.learning_rate, weight_decay=1e-4)
        averaged = averaged_model(model, plan.averaging)
        at = load_checkpoint(out.path, model, averaged, optimiser) or Progressed(0, math.inf, 0)
        step_loss = processes.wrap(TrainingStep(model))
        motions = [_motion(track(i)) for i in range(episodes)]
        loss = math.nan
        with Journal.open(out.path, at.step, enabled=processes.first) as journal:
            for step in range(at.step, plan.steps):
                loss, log = _one_step(step_loss, optimiser, track, motions, plan, step, processes)
                averaged.update_parameters(model)
                journal.write(step, loss, log)
                done = step + 1
                if processes.first and (done % plan.validate_every == 0 or done == plan.steps):
                    at = _validate(averaged, score, at, done, out, about or {})
                    journal.write(step, loss, score.figure(at.best_error))
                at = replace(at, step=done)
                if processes.first and (done % plan.checkpoint_every == 0 or done == plan.steps):
                    save_checkpoint(out.path, model, averaged, optimiser, at)
                phase = "on tracks" if step < plan.track_steps else "on images"
                out.progress(done, plan.steps, f"train {phase}", loss=loss, **score.figure(at.best_error))
    Model(out.path).checkpoint.unlink(missing_ok=True)
    return {"best_step": at.best_step, **score.figure(at.best_error), "loss": loss}


def _one_step(
    step_loss: nn.Module,
    optimiser: torch.optim.Optimizer,
    track: Callable[[int], Track],
    motions: list[np.ndarray],
    plan: TrainConfig,
    step: int,
    processes: Processes,
) -> tuple[float, dict[str, float]]:
    if plan.epochs and step >= plan.track_steps:
        lengths, at = [len(motion) for motion in motions], step - plan.track_steps
        windows = whole_episodes(lengths, plan.batch, plan.horizon, plan.views, seed=plan.seed, step=at)
    else:
        windows = draw_windows(
            motions, plan.batch, plan.horizon_at(step), seed=plan.seed, step=step, mirror=plan.mirror
        )
    mine = share(windows, processes)
    weights = replace(plan.weights, image=0.0) if step < plan.track_steps else plan.weights
    for group in optimiser.param_groups:
        group["lr"] = plan.rate_at(step)
    optimiser.zero_grad()
    loss, log = step_loss(mine, [track(w.episode) for w in mine], weights, plan.render, plan.noise_m, plan.views)
    loss.backward()
    nn.utils.clip_grad_norm_(step_loss.parameters(), 1.0)
    optimiser.step()
    return processes.mean(float(loss.detach())), log


def averaged_model(model: nn.Module, decay: float) -> AveragedModel:
    """Start the running average of a model's weights; the decay grows from 0 so that initial weights are forgotten."""

    def moved(average: Tensor, value: Tensor, number: Tensor | int) -> Tensor:
        return average.lerp(value, 1 - min(decay, int(number) / (9 + int(number))))

    averaged = AveragedModel(model, avg_fn=moved, use_buffers=True)
    averaged.update_parameters(model)  # the first one is a copy
    return averaged


def _motion(track: Track) -> np.ndarray:
    """Mean motion of each step of an episode, shape [T - 1] [m]; zeros where nothing was tracked."""
    if len(track) == 1:
        return np.zeros(len(track.actions) - 1)
    return np.asarray(track.means.diff(dim=0).norm(dim=-1).mean(dim=1).cpu(), dtype=np.float64)


@dataclass(frozen=True)
class _Score:
    """The error of rollouts that selects the weights."""

    episode: Callable[[int], Track]
    count: int
    plan: TrainConfig

    def of(self, model: LearnedModel) -> float:
        """Return the mean over the episodes."""
        return sum(self._one(model, self.episode(i)) for i in range(self.count)) / self.count

    def _one(self, model: LearnedModel, track: Track) -> float:
        if self.plan.follows_tracks:
            return rollout_error_m(model, track)
        return rollout_image_loss(model, track, self.plan.render)

    def figure(self, error: float) -> dict[str, float]:
        """Return an error under its name."""
        return {"rollout_error_mm": error * 1e3} if self.plan.follows_tracks else {"rollout_image_loss": error}


def _validate(
    averaged: AveragedModel, score: _Score, at: Progressed, step: int, out: Output, about: Mapping[str, Any]
) -> Progressed:
    """Roll out the judging episodes with the averaged model; write its weights if they are the best so far."""
    model = cast(LearnedModel, averaged.module)
    error = score.of(model)
    if error <= at.best_error or not Model(out.path).facts.exists():
        save_model(out.path, model, training={**about, "step": step, **score.figure(error)})
        return Progressed(at.step, error, step)
    return at


@torch.no_grad()
def rollout_error_m(model: LearnedModel, track: Track) -> float:
    """Mean distance of an open-loop rollout (without resampling) to the track, over frames and Gaussians [m]."""
    state = at_rest(track.initial)
    total = 0.0
    for frame in range(1, len(track)):
        state = model.move(state, track.actions.step(frame - 1))
        total += float((state.gaussians.means - track.means[frame]).norm(dim=-1).mean())
    return total / max(1, len(track) - 1)


@torch.no_grad()
def rollout_image_loss(model: LearnedModel, track: Track, weights: RenderWeights) -> float:
    """Mean rendering loss of an open-loop rollout, with resampling, over frames and views."""
    state, generator = at_rest(track.initial), torch.Generator("cpu").manual_seed(0)
    total = 0.0
    for frame, action in enumerate(track.actions.steps(), start=1):
        state = model.step(state, action, generator=generator)
        total += float(image_loss(track, state.gaussians, frame, weights))
    return total / max(1, len(track.actions) - 1)
