"""A model with effects: prediction of the base + (engine with the effects - engine without)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from plop.dynamics.interface import DynamicsModel, ParticleState, ToolStep
from plop.physics.adapters.filled import EngineBase
from plop.physics.adapters.filled_model import FilledEngineModel
from plop.physics.effects.effect import Effect

_NEIGHBOURS = 4


@dataclass(frozen=True)
class Twins:
    """The two engine runs and the base's own private state: `ParticleState.inner` after a step."""

    acted: ParticleState
    """With the effects."""
    plain: ParticleState
    """Without."""
    of_base: object | None

    @property
    def difference(self) -> Tensor:
        """Displacement caused by the effects since the start, shape [N, 3] [m]."""
        return self.acted.gaussians.means - self.plain.gaussians.means


class AugmentedModel(DynamicsModel):
    """A `DynamicsModel` around another one, which is not changed."""

    def __init__(self, base: DynamicsModel, engine: EngineBase, effects: tuple[Effect, ...]) -> None:
        """Create the model.

        Args:
            base: Any model.
            engine: Settings of the engine that computes the difference.
            effects: The added laws.
        """
        self.base, self.engine, self.effects = base, engine, effects
        self._with = FilledEngineModel(engine, effects)
        self._without = FilledEngineModel(engine)

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        """Advance one frame: the base's step, and the displacement caused by the effects in the engine.

        The two engine runs start at a state without history, or of another model, and then continue independently, in
        time steps of the same length.
        """
        twins = state.inner
        if not isinstance(twins, Twins) or not state.has_history:
            fresh = replace(state, has_history=False, inner=None)
            twins = Twins(fresh, fresh, twins.of_base if isinstance(twins, Twins) else state.inner)
        acted, step_s = self._with.stepped(twins.acted, action)
        plain, _ = self._without.stepped(twins.plain, action, step_s)
        stepped = self.base.step(replace(state, inner=twins.of_base), action, generator=generator)
        after = Twins(acted, plain, stepped.inner)
        means = stepped.gaussians.means
        moved = _at_descendants(twins.acted, after.difference - twins.difference, stepped).to(means)
        return replace(
            stepped,
            gaussians=stepped.gaussians.with_(means=means + moved),
            last_translation=stepped.last_translation + moved,
            inner=after,
        )


def _at_descendants(acted: ParticleState, added: Tensor, stepped: ParticleState) -> Tensor:
    """Return for each Gaussian the displacement of its ancestor, [M, 3] [m].

    Ancestors are found by lineage ids, independent of positions; without ids the nearest neighbours are used.

    Args:
        acted: The engine's Gaussians.
        added: Their displacement, [N, 3] [m].
        stepped: The base's M Gaussians.
    """
    known, wanted = acted.gaussians.ids.cpu().numpy(), stepped.gaussians.ids.cpu().numpy()
    order = np.argsort(known)
    row = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(known) - 1)]
    if len(np.unique(known)) == len(known) and (known[row] == wanted).all():
        return added.cpu()[torch.from_numpy(row)]
    places = acted.gaussians.means.detach().cpu().double().numpy()
    return torch.from_numpy(
        _interpolated(places, added.cpu().double().numpy(), stepped.gaussians.means, acted.side, stepped.side)
    )


def _interpolated(places: np.ndarray, values: np.ndarray, means: Tensor, sides: Tensor, wanted: Tensor) -> np.ndarray:
    """Interpolate values at other positions: nearest neighbours on the same side of the cut.

    Args:
        places: [N, 3] [m].
        values: [N, 3].
        means: Positions of the result, [M, 3] [m].
        sides: Side of each given position, [N].
        wanted: Side of each point, [M].
    """
    target = means.detach().cpu().double().numpy()
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
