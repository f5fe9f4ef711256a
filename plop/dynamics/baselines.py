"""The trivial model: the filter's initial one, and a baseline that every learned model must beat."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from plop.dynamics.cut import advance_sides
from plop.dynamics.interface import DynamicsModel, ParticleState, ToolStep


@dataclass(frozen=True)
class ConstantVelocity(DynamicsModel):
    """The last motion continues, damped."""

    keep: float = 0.8
    """Share of the last motion that is repeated [-]; 0: nothing moves."""

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
