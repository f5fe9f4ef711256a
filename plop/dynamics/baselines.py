"""Trivial models: baselines that every learned model must beat, and the filter's initial model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from plop.dynamics.cut import advance_sides
from plop.dynamics.interface import DynamicsModel, ParticleState, ToolStep


@dataclass(frozen=True)
class Persistence(DynamicsModel):
    """Nothing moves."""

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        """Keep the state; only the sides of the cut are updated."""
        zeros = torch.zeros_like(state.last_translation)
        side = advance_sides(state.side, state.gaussians.means, action)
        return replace(state, last_translation=zeros, last_rotation=zeros, side=side, has_history=True)


@dataclass(frozen=True)
class ConstantVelocity(DynamicsModel):
    """The last motion continues, damped."""

    keep: float = 0.8
    """Share of the last motion that is repeated [-]."""

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        """Repeat a share of the last translation."""
        shift = state.last_translation * self.keep
        means = state.gaussians.means + shift
        side = advance_sides(state.side, means, action)
        return replace(
            state,
            gaussians=state.gaussians.with_(means=means),
            last_translation=shift,
            last_rotation=torch.zeros_like(state.last_rotation),
            side=side,
            has_history=True,
        )
