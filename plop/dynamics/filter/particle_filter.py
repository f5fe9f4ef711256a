"""The particle filter over Gaussians: predict, update on the measured frame, resample (PLOP, Sec. III-C).

The likelihood is the rendering loss. The update optimises a displacement field that lowers it: a smooth
field on a coarse grid, u(x) = U0(x) + side U1(x), where U1 opens the cut between particles on its two
sides, and isometry keeps neighbours together. Particles that no camera sees follow their neighbours, and material
under a pressing tool is displaced by it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import torch
from torch import Tensor

from plop.dynamics.episodes import Actions, measured_views
from plop.dynamics.filter.tool_contact import SolidTool
from plop.dynamics.initial_surface import initial_surface
from plop.dynamics.interface import DynamicsModel, ParticleState, at_rest
from plop.dynamics.losses.physical import Neighbourhood, isometry, local_rotations
from plop.dynamics.particle_grid.grid import GridBox, fit_grid
from plop.dynamics.particle_grid.kernels import Stencil, build_stencil
from plop.dynamics.particle_grid.transfer import g2p
from plop.gaussians.state import Gaussians
from plop.geometry.rigid import (
    matrix_to_quat,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_multiply,
    rotation_vector_from_quat,
)
from plop.recordings.recording import Recording
from plop.render.losses import RenderWeights, Target, render_loss
from plop.render.rasterizer.rasterize import render
from plop.setting_kinds import COMMON, Formerly, Range, Settings, Unit, Weight


@dataclass(frozen=True)
class UpdateConfig(Settings):
    """How the filter updates a predicted state; the defaults are written only here."""

    iterations: Annotated[int, Range(0), Unit("steps"), COMMON, Formerly("filter_iterations")] = 40
    """Gradient steps of the filter on a frame."""
    views: Annotated[int, Range(1), Unit("views")] = 2
    """Views in each of these steps, drawn in turn."""
    cells_across: Annotated[float, Range(1, 64), Unit("cells")] = 7.0
    """Cells of the displacement grid along the object's longest extent."""
    step_m: Annotated[float, Range(0, 1, above=True), Unit("m")] = 4e-4
    """Initial step of Adam on the displacement; decays to a tenth by a cosine schedule."""
    opacity_step: Weight = 0.02
    """Step of Adam on the opacity logit; 0 keeps opacities fixed."""
    isometry: Weight = 1.0
    """Weight of the isometry term, counted in `render.depth_unit_m` as depth is."""
    contact: Weight = 1.0
    """Weight of the penetration of Gaussians into a solid tool other than a blade, in `render.depth_unit_m`."""
    smoothness: Weight = 0.3
    """Weight of the difference between neighbouring grid nodes, in `render.depth_unit_m`."""


@dataclass(frozen=True)
class FilterStep:
    """One frame of the filter."""

    frame: int
    predicted: ParticleState
    updated: ParticleState
    innovation: dict[str, dict[str, float]]
    """Per camera: {"l1", "depth_mm", "updated_l1", "updated_depth_mm"} of predicted and updated state."""


def run_filter(
    model: DynamicsModel,
    recording: Recording,
    initial: Gaussians,
    config: UpdateConfig,
    *,
    weights: RenderWeights | None = None,
    cameras: list[str] | None = None,
    generator: torch.Generator | None = None,
    score: bool = True,
) -> Iterator[FilterStep]:
    """Filter one episode, frame by frame.

    Args:
        model: Predicts; also resamples.
        recording: The episode.
        initial: Gaussians at frame 0.
        config: The update.
        weights: Weights of the rendering loss; the defaults when absent.
        cameras: Cameras to use; all when absent.
        generator: Random generator of the model.
        score: Measure the innovation per camera (costs two renderings per camera).

    Yields:
        Frames 1 to T - 1.
    """
    actions = Actions.of(recording, initial.means.device)
    state = at_rest(initial, initial_surface(recording, initial))
    pairs = Neighbourhood.of(initial.means)
    length = float((initial.means.amax(0) - initial.means.amin(0)).max())
    for frame in range(1, len(actions)):
        with torch.no_grad():
            predicted = model.step(state, actions.step(frame - 1), generator=generator)
        if predicted.resampling is not None:
            parents = predicted.resampling.parents
            pairs, state = pairs.following(parents), state.select(parents)
        views = measured_views(recording, frame, cameras, initial.means.device)
        tool = SolidTool.of(actions.tool, actions.world_from_tool[frame])
        updated = update(predicted, state.gaussians, views, pairs, length, config, tool, weights)
        innovation = _innovation(predicted, updated, views) if score else {}
        yield FilterStep(frame, predicted, updated, innovation)
        state = updated


def settled(
    initial: Gaussians, views: list[Target], config: UpdateConfig, rounds: int, weights: RenderWeights | None = None
) -> Gaussians:
    """Update the first frame on its own views, so that it is consistent with later updates.

    A fit weights colour, depth and shape differently than the update: without this the first step moves the
    object by that difference (0.15 mm in simulated recordings), which appears as motion.

    Args:
        initial: Gaussians as fitted to frame 0.
        views: Measured views of frame 0.
        config: The update.
        rounds: Number of updates; each starts with a full step. With 0 the Gaussians are unchanged.
        weights: Weights of the rendering loss; the defaults when absent.
    """
    length = float((initial.means.amax(0) - initial.means.amin(0)).max())
    for _ in range(rounds):
        pairs = Neighbourhood.of(initial.means)
        initial = update(at_rest(initial), initial, views, pairs, length, config, weights=weights).gaussians
    return initial


class _Displacement:
    """The unknowns of one update: two fields on a grid, and the opacity logits."""

    def __init__(self, state: ParticleState, spacing_m: float) -> None:
        means = state.gaussians.means
        alone = torch.zeros(len(means), dtype=torch.int64, device=means.device)
        self.box: GridBox = fit_grid(means, alone, 1, spacing_m, stride=1, room=1)
        self.stencil: Stencil = build_stencil(means - self.box.origin[0], spacing_m, self.box.shape, "quadratic")
        self.fields = means.new_zeros(self.box.size, 6).requires_grad_()
        self.logits = torch.logit(state.gaussians.opacities.clamp(1e-4, 1 - 1e-4)).requires_grad_()
        self.state = state

    def shift(self) -> Tensor:
        """Displacement of each particle, shape [N, 3] [m]."""
        both = g2p(self.fields, self.stencil)
        return both[:, :3] + self.state.side[:, None] * both[:, 3:]

    def roughness(self) -> Tensor:
        """Mean absolute difference between neighbouring nodes [m], scalar."""
        grid = self.fields.reshape(*self.box.shape, 6)
        parts = [grid.diff(dim=axis).abs().mean() for axis in range(3) if self.box.shape[axis] > 1]
        return torch.stack(parts).mean()

    def apply(self) -> Gaussians:
        """The Gaussians, displaced."""
        gaussians = self.state.gaussians
        return gaussians.with_(means=gaussians.means + self.shift(), opacities=torch.sigmoid(self.logits))


def update(
    predicted: ParticleState,
    before: Gaussians,
    views: list[Target],
    pairs: Neighbourhood,
    length_m: float,
    config: UpdateConfig,
    tool: SolidTool | None = None,
    weights: RenderWeights | None = None,
) -> ParticleState:
    """Move a predicted state towards the measured views (Eq. 4).

    Args:
        predicted: Prediction for this frame.
        before: State of the last frame, the same Gaussians in the same order.
        views: Measured views; with none the prediction is returned.
        pairs: Neighbours at frame 0, indices into the predicted state.
        length_m: Longest extent of the object [m].
        config: The update.
        tool: Pose of the tool in this frame, if it is solid.
        weights: Weights of the rendering loss; the defaults when absent.

    Returns:
        Updated state; rotations follow the neighbourhoods' best rotation since the last frame.
    """
    if not views:
        return predicted
    unknown = _Displacement(predicted, length_m / config.cells_across)
    intact = pairs.severed(predicted.side)
    groups = [{"params": [unknown.fields], "lr": config.step_m}]
    if config.opacity_step > 0:
        groups.append({"params": [unknown.logits], "lr": config.opacity_step})
    optimiser = torch.optim.Adam(groups)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, config.iterations, eta_min=config.step_m / 10)
    weights = weights or RenderWeights()
    unit = weights.depth_unit_m
    for iteration in range(config.iterations):
        moved = unknown.apply()
        loss = (config.isometry * isometry(intact, moved) + config.smoothness * unknown.roughness()) / unit
        if tool is not None and config.contact > 0:
            loss = loss + config.contact * tool.overlap_m(moved.means) / unit
        chosen = [views[(iteration * config.views + k) % len(views)] for k in range(min(config.views, len(views)))]
        for view in chosen:
            loss = loss + render_loss(render(moved, view.camera), view, weights)[0] / len(chosen)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    with torch.no_grad():
        return _with_motion(predicted, before, unknown.apply().detach(), intact)


def _with_motion(predicted: ParticleState, before: Gaussians, moved: Gaussians, pairs: Neighbourhood) -> ParticleState:
    turn = matrix_to_quat(local_rotations(pairs, before.means, moved.means, len(moved)))
    # Shapes come from the prediction (an engine and a blade change them): rotated back to the start, then as measured.
    back = quat_conjugate(quat_from_rotation_vector(predicted.last_rotation))
    quats = torch.nn.functional.normalize(quat_multiply(turn, quat_multiply(back, moved.quats)), dim=-1)
    return replace(
        predicted,
        gaussians=moved.with_(quats=quats),
        last_translation=moved.means - before.means,
        last_rotation=rotation_vector_from_quat(turn),
        has_history=True,
    )


def _innovation(predicted: ParticleState, updated: ParticleState, views: list[Target]) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    with torch.no_grad():
        for view in views:
            row = {}
            for prefix, state in (("", predicted), ("updated_", updated)):
                _, terms = render_loss(render(state.gaussians, view.camera), view)
                row[f"{prefix}l1"] = float(terms["l1"])
                row[f"{prefix}depth_mm"] = float(terms["depth_m"]) * 1e3
            found[view.camera.name] = row
    return found
