"""A model with effects: prediction of the base + (engine with the effects - engine without)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from plop.dynamics.interface import DynamicsModel, ParticleState, ToolStep
from plop.physics.effects.effect import Effect
from plop.physics.filled import EngineBase
from plop.physics.filled_model import FilledEngineModel

_NEIGHBOURS = 4


class AugmentedModel:
    """A `DynamicsModel` around another one; taking the base out again gives the base back unchanged."""

    def __init__(self, base: DynamicsModel, engine: EngineBase, effects: tuple[Effect, ...]) -> None:
        """Hold base and engine.

        Args:
            base: Any model.
            engine: Settings of the engine that computes the difference.
            effects: The laws that are added.
        """
        self.base, self.engine, self.effects = base, engine, effects
        self._with = FilledEngineModel(engine, effects)
        self._without = FilledEngineModel(engine)
        self._twins: tuple[ParticleState, ParticleState] | None = None

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        """Advance one frame: the base's step, and the step that the effects make in the engine.

        The two engine runs start at a state without history and go on by themselves.
        """
        if self._twins is None or not state.has_history:
            fresh = replace(state, has_history=False)
            self._with, self._without = FilledEngineModel(self.engine, self.effects), FilledEngineModel(self.engine)
            self._twins = fresh, fresh
        before = self._difference()
        acted, plain = self._twins
        self._twins = self._with.step(acted, action), self._without.step(plain, action)
        added = self._difference() - before
        stepped = self.base.step(state, action, generator=generator)
        places = self._twins[0].gaussians.means.detach().cpu().double().numpy()
        means = stepped.gaussians.means
        values = added.cpu().double().numpy()
        moved = torch.from_numpy(_interpolated(places, values, means, acted.side, stepped.side)).to(means)
        return replace(stepped, gaussians=stepped.gaussians.with_(means=means + moved),
                       last_translation=stepped.last_translation + moved)  # fmt: skip

    def _difference(self) -> Tensor:
        assert self._twins is not None
        return self._twins[0].gaussians.means - self._twins[1].gaussians.means


def _interpolated(places: np.ndarray, values: np.ndarray, means: Tensor, sides: Tensor, wanted: Tensor) -> np.ndarray:
    """Read values known at some places off at others: nearest neighbours on the same side of the cut.

    Args:
        places: [N, 3] [m].
        values: [N, 3].
        means: Where they are wanted, [M, 3] [m].
        sides: Side of each place, [N].
        wanted: Side of each point, [M].
    """
    target = means.detach().cpu().double().numpy()
    if len(target) == len(places) and np.abs(target - places).max() < 1e-9:
        return values
    found = np.zeros_like(target)
    own, side = sides.cpu().numpy().round(), wanted.cpu().numpy().round()
    for value in np.unique(side):
        rows = np.flatnonzero(side == value)
        known = np.flatnonzero(own == value)
        if len(known) < _NEIGHBOURS:
            known = np.arange(len(places))
        distance, nearest = cKDTree(places[known]).query(target[rows], k=min(_NEIGHBOURS, len(known)))
        distance, nearest = distance.reshape(len(rows), -1), nearest.reshape(len(rows), -1)
        weight = 1 / (distance + 1e-4)
        found[rows] = (weight[..., None] * values[known[nearest]]).sum(1) / weight.sum(1)[:, None]
    return found
