"""The engine behind the interface that the learned models have: one frame of Gaussians after the other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from plop.dynamics.interface import ParticleState, ToolStep
from plop.gaussians.carried import carried
from plop.physics.config import EngineConfig
from plop.physics.fill import particle_volumes
from plop.physics.material import Material
from plop.physics.particles import Particles
from plop.physics.solver import simulate
from plop.physics.tool_motion import ToolKind, ToolMotion, ToolShape

_SAME_PLACE_M = 1e-7


@dataclass
class _Memory:
    """What the engine knows about the Gaussians of its last step and `ParticleState` does not carry."""

    ids: Tensor
    particles: Particles
    dx_m: float


class EngineModel:
    """A `DynamicsModel`: means are particles, the deformation gradient carries the covariances.

    The Gaussians must fill the object (fit-init's `solid` filling); their number, colour and opacity do not
    change. Velocity, deformation gradient and the local velocity are kept from step to step; where a filter
    has moved the Gaussians in between, the positions are the filter's and the rest is kept.
    """

    def __init__(self, material: Material, config: EngineConfig | None = None) -> None:
        """Hold what to simulate with.

        Args:
            material: What the object is made of.
            config: Grid and gravity; None takes twice the Gaussians' spacing as grid. The table's height is
                always that of the recording.
        """
        self.material, self.config = material, config
        self._memory: _Memory | None = None

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        """Advance one frame; nothing is random, `generator` is not used."""
        gaussians = state.gaussians
        motion = tool_motion(action)
        normal = same_normal(motion, action)
        particles, dx_m = self._start(state, normal, action.dt_s)
        config = replace(self.config or EngineConfig(dx_m=dx_m), table_z_m=action.table_z_m)
        run = simulate(particles, self.material, motion, np.array([0.0, action.dt_s]), config)
        self._memory = _Memory(gaussians.ids.clone(), run.final, dx_m)
        after, rotation = carried(gaussians, run.positions[-1], run.F[-1] @ np.linalg.inv(run.F[0]))
        side = torch.from_numpy(normal * run.sides[-1].astype(np.float32)).to(state.side)
        return ParticleState(after, after.means - gaussians.means, rotation, side, has_history=True)

    def _start(self, state: ParticleState, normal: int, dt_s: float) -> tuple[Particles, float]:
        """Combine the state with what is remembered; a first frame forgets everything."""
        means = state.gaussians.means.detach().cpu().double().numpy()
        side = normal * state.side.detach().cpu().numpy().round().astype(np.int64)
        memory = self._memory
        if memory is None or not state.has_history or not torch.equal(memory.ids, state.gaussians.ids):
            volumes, spacing = particle_volumes(means)
            velocity = state.last_translation.detach().cpu().double().numpy() / dt_s if state.has_history else None
            return Particles(means, volumes, velocity, sides=side, passed=side != 0), 2 * spacing
        known = memory.particles
        moved = np.abs(known.positions - means).max() > _SAME_PLACE_M
        return replace(known, positions=means if moved else known.positions, sides=side, passed=side != 0), memory.dx_m


def tool_motion(action: ToolStep) -> ToolMotion:
    """Give one step's action as the engine's tool motion, starting at time 0."""
    poses = torch.stack([action.world_from_tool, action.next_world_from_tool]).detach().cpu().double().numpy()
    return ToolMotion(action.tool.vertices.cpu().double().numpy(), action.tool.faces.cpu().numpy(),
                      np.array([0.0, action.dt_s]), poses)  # fmt: skip


def same_normal(motion: ToolMotion, action: ToolStep) -> int:
    """+1 where the engine and the state's sides call the same direction the blade's normal, else -1."""
    normal = ToolShape.from_mesh(motion.vertices, motion.faces, ToolKind.BLADE).axes[:, 0]
    return 1 if normal @ action.tool.axes[:, 0].cpu().double().numpy() > 0 else -1
