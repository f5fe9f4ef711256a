"""The engine as a dynamics model of Gaussians that need not fill the object: it fills the object with particles.

The particles are those of `filled_particles`; the Gaussians move with the material as tracers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from plop.dynamics.cut import narrowed_at_cut
from plop.dynamics.interface import DynamicsModel, ParticleState, ToolStep
from plop.gaussians.deformation import deformed
from plop.geometry.meshes.convex import convex_surface
from plop.physics.adapters.filled import EngineBase, filled_particles
from plop.physics.effects.effect import Effect
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.physics.engine.tool_motion import ToolKind, ToolMotion, ToolShape

_OPAQUE = 0.3
"""Smallest opacity of Gaussians that locate the object."""


@dataclass(frozen=True)
class EngineState:
    """The engine's private state: `ParticleState.inner` after a step."""

    particles: Particles
    """The material, followed by one tracer for each Gaussian."""
    means: Tensor
    """Positions of the Gaussians as returned, shape [N, 3] [m]; the material follows later changes."""
    ids: Tensor
    """Their ids, shape [N]."""


class FilledEngineModel(DynamicsModel):
    """A `DynamicsModel`: the engine with its own particles; neither merges nor splits Gaussians."""

    def __init__(self, base: EngineBase, effects: tuple[Effect, ...] = (), *, cut_faces: bool = False) -> None:
        """Create the model.

        Args:
            base: The engine's settings.
            effects: Laws in addition to the base material.
            cut_faces: Whether a Gaussian that a blade passes is narrowed so that it does not extend across the cut; its
                motion does not depend on this.
        """
        self.base, self.effects, self.cut_faces = base, effects, cut_faces

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        """Advance one frame; nothing is random, `generator` is not used.

        A state without history, or of another model, starts a new run. Gaussians that a filter has moved or resampled
        since the last step move the material around them.
        """
        return self.stepped(state, action)[0]

    def stepped(
        self, state: ParticleState, action: ToolStep, most_step_s: float = np.inf
    ) -> tuple[ParticleState, float]:
        """Advance one frame in time steps of at most `most_step_s`; return the time step, too [s]."""
        gaussians = state.gaussians
        particles = self._particles(state, action)
        motion = tool_motion(action)
        config = replace(self.base.config, table_z_m=action.table_z_m)
        times = np.array([0.0, action.dt_s])
        run = simulate(
            particles, self.base.material, motion, times, config, effects=self.effects, most_step_s=most_step_s
        )
        own = slice(len(particles) - len(gaussians), None)
        # displacements, not positions: a settled object lies a little deeper in the grid than it was measured
        places = gaussians.means.detach().cpu().double().numpy() + (run.positions[-1] - run.positions[0])[own]
        after, rotation = deformed(gaussians, places, run.F[-1][own] @ np.linalg.inv(run.F[0][own]))
        normal = same_normal(motion, action)
        side = torch.from_numpy(normal * run.sides[-1][own].astype(np.float32)).to(state.side)
        inner = EngineState(run.final, after.means.detach(), after.ids)
        moved = ParticleState(after, after.means - gaussians.means, rotation, side, has_history=True, inner=inner)
        return narrowed_at_cut(state.side, moved, action) if self.cut_faces else moved, run.dt_s

    def _particles(self, state: ParticleState, action: ToolStep) -> Particles:
        means = state.gaussians.means.detach().cpu().double().numpy()
        known = state.inner
        if not isinstance(known, EngineState) or not state.has_history:
            return self._first(state, means, action.table_z_m)
        same = torch.equal(known.ids, state.gaussians.ids)
        if same and torch.equal(known.means, state.gaussians.means):
            return known.particles
        return self._moved(known, means if same else None, state)

    def _first(self, state: ParticleState, means: np.ndarray, table_z_m: float | None) -> Particles:
        solid = means[state.gaussians.opacities.detach().cpu().numpy() >= _OPAQUE]
        surface = state.surface or convex_surface(solid if len(solid) >= 4 else means, table_z_m)
        return filled_particles(self.base, surface, means, table_z_m, self.effects)

    def _moved(self, last: EngineState, means: np.ndarray | None, state: ParticleState) -> Particles:
        """Shift the material as the Gaussians around it were shifted by a filter's update."""
        from scipy.spatial import cKDTree

        known = last.particles
        filling = len(known) - len(last.means)
        before = last.means.cpu().double().numpy()
        now = state.gaussians.means.detach().cpu().double().numpy()
        if means is None:  # split or merged: compare positions with the nearest former Gaussian
            _, nearest = cKDTree(before).query(now)
            keep = np.concatenate([np.arange(filling), filling + nearest])
            known, before = known.select(keep), before[nearest]
        shift = now - before
        distance, nearest = cKDTree(before).query(known.positions[:filling], k=min(8, len(before)))
        weight = 1 / (distance + 1e-4)
        inner = (weight[..., None] * shift[nearest]).sum(1) / weight.sum(1)[:, None]
        return replace(known, positions=known.positions + np.concatenate([inner, shift]))


def tool_motion(action: ToolStep) -> ToolMotion:
    """Return one step's action as the engine's tool motion, starting at time 0."""
    poses = torch.stack([action.world_from_tool, action.next_world_from_tool]).detach().cpu().double().numpy()
    return ToolMotion(
        action.tool.vertices.cpu().double().numpy(),
        action.tool.faces.cpu().numpy(),
        np.array([0.0, action.dt_s]),
        poses,
    )


def same_normal(motion: ToolMotion, action: ToolStep) -> int:
    """Return +1 where engine and state use the same direction of the blade's normal, else -1."""
    normal = ToolShape.from_mesh(motion.vertices, motion.faces, ToolKind.BLADE).axes[:, 0]
    return 1 if normal @ action.tool.axes[:, 0].cpu().double().numpy() > 0 else -1
