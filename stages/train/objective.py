"""The loss of one optimisation step (PLOP, Eq. 14-15): rollouts from the filter's states, or from fitted Gaussians.

Each window is rolled out for its horizon. Every predicted frame is compared with measured views (rendering loss),
and with the filter's track where there is one; the physical terms are added.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import torch
from torch import Tensor, nn

from plop.dynamics.episodes import measured_views
from plop.dynamics.interface import ParticleState
from plop.dynamics.learned import LearnedModel
from plop.dynamics.losses.physical import Neighbourhood, isometry, rigidity, rotation_similarity
from plop.dynamics.resampling import effective_sample_size, resample
from plop.gaussians.state import Gaussians
from plop.recordings.recording import Recording
from plop.render.losses import RenderWeights, Target, render_loss
from plop.render.rasterizer.rasterize import render_many
from stages.train.settings import LossWeights
from stages.train.tracks import Track
from stages.train.windows import Window, disturbed_start

ROTATION_ARM_M = 0.01
"""Length that converts rotation errors of a Gaussian to position errors [m]."""
SMOOTH_M = 1e-5
"""Error below which the loss is quadratic [m]. In most frames of a cut hardly anything moves, and a spurious motion of
a few hundredths of a millimetre per frame drifts by half a millimetre until the end: it must be penalised."""


@dataclass
class _Rollout:
    """State of one window during its rollout."""

    window: Window
    track: Track
    state: ParticleState
    pairs: Neighbourhood
    rows: Tensor
    """Row of the track's Gaussians that each Gaussian descends from, shape [N]."""
    offset: Tensor
    """Perturbation of the start, by row of the track, shape [N0, 3] [m]."""
    merges: int = 0
    splits: int = 0


class TrainingStep(nn.Module):
    """A module whose forward is the loss, so that PyTorch's data parallelism can wrap it."""

    def __init__(self, model: LearnedModel) -> None:
        super().__init__()
        self.model = model

    def forward(
        self,
        windows: list[Window],
        tracks: list[Track],
        weights: LossWeights,
        images: RenderWeights,
        noise_m: float,
        views: int = 1,
    ) -> tuple[Tensor, dict[str, float]]:
        """Roll out the windows and add up the loss.

        Args:
            windows: Windows of this step (of this process).
            tracks: Track of each window.
            weights: Weights of the terms.
            images: Weights of the rendering loss.
            noise_m: Perturbation of the start states [m].
            views: Views in the rendering loss of a frame; 0 is all.

        Returns:
            Mean loss per window and step, and its terms and counts for the log.
        """
        rollouts = []
        for window, track in zip(windows, tracks, strict=True):
            start, offset = disturbed_start(track, window, noise_m)
            rows = torch.arange(len(start.gaussians), device=offset.device)
            rollouts.append(_Rollout(window, track, start, track.pairs, rows, offset))
        total = rollouts[0].offset.new_zeros(())
        log: dict[str, float] = {}
        steps = sum(window.horizon for window in windows)
        for k in range(max(window.horizon for window in windows)):
            active = [r for r in rollouts if k < r.window.horizon]
            for rollout, predicted in zip(active, self._predict(active, k), strict=True):
                terms = _advance(rollout, predicted, k, self.model, weights, images, views)
                total = total + sum(terms.values(), total.new_zeros(()))
                for name, value in terms.items():
                    log[name] = log.get(name, 0.0) + float(value.detach()) / steps
        states = [r.state.gaussians for r in rollouts]
        log["gaussians"] = sum(len(s) for s in states) / len(states)
        log["effective_sample_size"] = sum(float(effective_sample_size(s.opacities.detach())) for s in states) / len(
            states
        )
        log["splits"] = sum(r.splits for r in rollouts) / steps
        log["merges"] = sum(r.merges for r in rollouts) / steps
        return total / steps, log

    def _predict(self, active: list[_Rollout], k: int) -> list[ParticleState]:
        actions = [r.track.actions.step(r.window.start + k) for r in active]
        pairs = zip(active, actions, strict=True)
        frames = [self.model.frame(action).reflected(*r.window.mirror) for r, action in pairs]
        return self.model.predict([r.state for r in active], actions, frames)


def _advance(
    rollout: _Rollout,
    predicted: ParticleState,
    k: int,
    model: LearnedModel,
    weights: LossWeights,
    images: RenderWeights,
    views: int,
) -> dict[str, Tensor]:
    """Score one predicted frame, then resample it in place; return the weighted terms."""
    frame = rollout.window.start + k + 1
    before = rollout.state.gaussians
    terms = _physical_terms(rollout.pairs, before, predicted, weights, images.depth_unit_m)
    if weights.track > 0:
        terms["track"] = weights.track * _track_error(rollout, predicted, frame) / images.depth_unit_m
    generator = torch.Generator("cpu").manual_seed(rollout.window.noise_seed + k)
    state = predicted
    if weights.image > 0:
        state = resample(predicted, model.config.resampling, generator=generator)
        if state.resampling is not None:
            parents = state.resampling.parents
            rollout.pairs, rollout.rows = rollout.pairs.following(parents), rollout.rows[parents]
            rollout.merges += state.resampling.merges
            rollout.splits += state.resampling.splits
        first = rollout.window.cameras[k]
        terms["image"] = weights.image * image_loss(rollout.track, state.gaussians, frame, images, views, first)
    rollout.state = state
    return terms


def _physical_terms(
    pairs: Neighbourhood, before: Gaussians, predicted: ParticleState, weights: LossWeights, unit_m: float
) -> dict[str, Tensor]:
    if weights.sever:
        pairs = pairs.severed(predicted.side)
    after = predicted.gaussians
    terms = {}
    if weights.rigid > 0:
        terms["rigid"] = weights.rigid * rigidity(pairs, before, after) / unit_m
    if weights.rotation > 0:
        terms["rotation"] = weights.rotation * rotation_similarity(pairs, before, after)
    if weights.isometry > 0:
        terms["isometry"] = weights.isometry * isometry(pairs, after) / unit_m
    return terms


def _track_error(rollout: _Rollout, predicted: ParticleState, frame: int) -> Tensor:
    """Mean distance to the track in position, rotation (times an arm's length) and shape, smooth below `SMOOTH_M` [m].

    The track's Gaussians keep their scales. Without the shape term the rendering loss causes a small drift of scales
    and opacities in each frame, which is invisible in windows of a few frames and thins out the object over an episode.
    """
    track, rows, now = rollout.track, rollout.rows, predicted.gaussians
    shift = now.means - (track.means[frame] + rollout.offset)[rows]
    turn = ROTATION_ARM_M * (predicted.last_rotation - track.rotations[frame][rows])
    size = track.initial.scales[rows]
    fade = (now.opacities - track.opacities[frame][rows])[:, None] * size
    errors = (shift, turn, now.scales - size, fade)
    return sum(((error.square().sum(-1) + SMOOTH_M**2).sqrt().mean() for error in errors), shift.new_zeros(()))


def image_loss(
    track: Track, gaussians: Gaussians, frame: int, weights: RenderWeights, views: int = 0, first: int = 0
) -> Tensor:
    """Compare Gaussians with measured views of a frame (PLOP, Eq. 9): the mean over the views, a scalar.

    Args:
        track: The episode; a simulated one has no images, and a loss of 0.
        gaussians: The object.
        frame: The frame.
        weights: Weights of the terms.
        views: Views to compare; 0 is all.
        first: Number of the first of them, modulo the count of cameras.
    """
    if track.recording_path is None:
        return gaussians.means.new_zeros(())
    names = _camera_names(track.recording_path)
    chosen = [names[(first + j) % len(names)] for j in range(views or len(names))]
    device = str(gaussians.means.device)
    targets = [view for name in chosen for view in _targets(track.recording_path, frame, name, device)]
    if not targets:
        return gaussians.means.new_zeros(())
    drawn = render_many(gaussians, [target.camera for target in targets])
    losses = [render_loss(rendering, target, weights)[0] for rendering, target in zip(drawn, targets, strict=True)]
    return sum(losses[1:], losses[0]) / len(losses)


@lru_cache(maxsize=64)
def _camera_names(path: Path) -> tuple[str, ...]:
    with Recording.open(path) as recording:
        return tuple(recording.camera_names)


@lru_cache(maxsize=1024)
def _targets(path: Path, frame: int, camera: str, device: str) -> list[Target]:
    """Read a view, once: an epoch meets each again. None where the view does not show the object."""
    with Recording.open(path) as recording:
        return measured_views(recording, frame, [camera], device)
