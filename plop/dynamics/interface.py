"""The common interface of all dynamics models: learned model, baseline, physics engine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from plop.dynamics.rest import RestPlaces
from plop.gaussians.state import Gaussians
from plop.geometry.meshes.tool import ToolGeometry


@dataclass(frozen=True)
class Resampling:
    """What merging and splitting did to the Gaussians in one step."""

    parents: Tensor
    """For each Gaussian the row, among those before, that it descends from, shape [N], int64."""
    merges: int
    """Gaussians that were absorbed."""
    splits: int
    """Gaussians that were split."""


@dataclass(frozen=True)
class ParticleState:
    """Complete state of a dynamics model between frames; a step depends on nothing else."""

    gaussians: Gaussians
    last_translation: Tensor
    """Motion of each mean over the last step, shape [N, 3] [m]; zero at the first frame."""
    last_rotation: Tensor
    """Rotation vector of each Gaussian over the last step, world frame, shape [N, 3] [rad]."""
    side: Tensor
    """Side of the cut on which a Gaussian lies, shape [N], -1, 0 (no blade has passed yet) or 1."""
    has_history: bool
    """False at the first frame, where the motion of the last step is undefined."""
    surface: tuple[np.ndarray, np.ndarray] | None = None
    """At the first frame, if it was measured: the object's closed surface, vertices [V, 3] [m] and triangles [F, 3],
    for models that fill it themselves (`plop.dynamics.initial_surface`)."""
    rest: RestPlaces | None = None
    """Positions of the Gaussians at the first frame, if needed (`plop.dynamics.cohesion`)."""
    inner: object | None = None
    """Private state of the model besides the Gaussians (e.g. the engine's particles); never changed in place. Other
    code passes it on unchanged, also where it moves or selects Gaussians."""
    resampling: Resampling | None = None
    """Merges and splits of the last step; None if the set of Gaussians is the same as before it."""

    def select(self, index: Tensor) -> ParticleState:
        """Select a subset of the Gaussians with all their fields."""
        return replace(
            self,
            gaussians=self.gaussians.select(index),
            last_translation=self.last_translation[index],
            last_rotation=self.last_rotation[index],
            side=self.side[index],
            rest=None if self.rest is None else self.rest.select(index),
            resampling=None,
        )

    def detach(self) -> ParticleState:
        """Copy without gradient history."""
        return replace(
            self,
            gaussians=self.gaussians.detach(),
            last_translation=self.last_translation.detach(),
            last_rotation=self.last_rotation.detach(),
        )


@dataclass(frozen=True)
class ToolStep:
    """The action of one step: the tool's pose before and after."""

    tool: ToolGeometry
    world_from_tool: Tensor
    """Pose at the start of the step, shape [4, 4]."""
    next_world_from_tool: Tensor
    """Pose at its end, shape [4, 4]."""
    dt_s: float
    """Duration of the step [s]."""
    table_z_m: float | None
    """Height of the table [m], None when there is none."""


class Start(Protocol):
    """Where a prediction starts; see `plop.dynamics.initial_scene`."""

    @property
    def gaussians(self) -> Gaussians:
        """The object, world frame."""

    @property
    def surface(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Its closed surface where it was measured: vertices [V, 3] [m] and triangles [F, 3]."""


class DynamicsModel(Protocol):
    """Predict the next state: prediction, opacity update, merging and splitting (PLOP, Eq. 13)."""

    def init(self, scene: Start) -> ParticleState:
        """Return the state at the first frame, at rest."""
        return at_rest(scene.gaussians, scene.surface)

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        """Advance one frame; where Gaussians merge or split, `resampling` of the result says how.

        The result depends on the arguments only and the state is not changed: a model may predict several episodes
        alternately, and step one state by several actions. `generator` draws random numbers (displacements of splits).
        """
        ...


def at_rest(gaussians: Gaussians, surface: tuple[np.ndarray, np.ndarray] | None = None) -> ParticleState:
    """Start a rollout from Gaussians without history, and the object's surface where it was measured."""
    zeros = torch.zeros_like(gaussians.means)
    rest = RestPlaces(gaussians.means.detach())
    return ParticleState(gaussians, zeros, zeros, zeros[:, 0], has_history=False, surface=surface, rest=rest)
