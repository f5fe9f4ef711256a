"""A peer as a dynamics model: sample particles, let its network move them, let the Gaussians follow.

Number, scale, colour and opacity of the Gaussians never change, as in gs-dynamics; nothing merges or splits.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from plop.dynamics.cut import advance_sides
from plop.dynamics.i2n.tool_frame import StepFrame, tool_frame, world_frame
from plop.dynamics.interface import DynamicsModel, ParticleState, ToolStep
from plop.dynamics.peers.edges import Edges, radius_edges
from plop.dynamics.peers.particles import FEATURES, ParticleSet, particle_set
from plop.dynamics.peers.propagation import PropagationNetwork
from plop.dynamics.peers.settings import GraphConfig, PeerName, TransformerConfig
from plop.dynamics.peers.skinning import local_turns, skin_weights, skinned
from plop.dynamics.peers.transformer import ParticleTransformer
from plop.dynamics.resampling import ResamplingConfig
from plop.geometry.rigid import quat_multiply, rotation_vector_from_quat


@dataclass(frozen=True)
class PeerConfig:
    """A peer's configuration and the units of its inputs and outputs."""

    dynamics: PeerName
    """Which model."""
    network: GraphConfig | TransformerConfig
    """Its size."""
    frame: str = "tool"
    """"tool" (turns with the tool about the vertical) or "world"."""
    length_m: float = 0.1
    """Longest extent of the object, from the training set [m]."""
    motion_m: float = 1e-3
    """Typical motion in a step, from the training set [m]."""

    @property
    def resampling(self) -> ResamplingConfig:
        """Nothing merges or splits."""
        return ResamplingConfig(enabled=False)


class PeerModel(nn.Module, DynamicsModel):
    """gs-dynamics, DPI-Net or a particle transformer."""

    def __init__(self, config: PeerConfig) -> None:
        super().__init__()
        self.config, size = config, config.network
        self.network: PropagationNetwork | ParticleTransformer
        if isinstance(size, TransformerConfig):
            self.network = ParticleTransformer(FEATURES, size.width, size.layers, size.heads)
        else:
            self.network = PropagationNetwork(FEATURES, size.width, size.propagations)

    @property
    def kind(self) -> str:
        """Name of the dynamics in model files."""
        return self.config.dynamics

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        """Advance one frame; nothing is random, `generator` is not used."""
        return self.move(state, action)

    def move(self, state: ParticleState, action: ToolStep) -> ParticleState:
        """Advance one frame."""
        return self.predict([state], [action])[0]

    def frame(self, action: ToolStep) -> StepFrame:
        """Return the frame of the network's input for a step."""
        return tool_frame(action) if self.config.frame == "tool" else world_frame(action)

    def predict(
        self, states: list[ParticleState], actions: list[ToolStep], frames: list[StepFrame] | None = None
    ) -> list[ParticleState]:
        """Predict several steps at once.

        Args:
            states: B states.
            actions: B actions.
            frames: Frames of the network's input; the configured ones when absent.

        Returns:
            B predicted states.
        """
        frames = frames or [self.frame(action) for action in actions]
        size, length_m, motion_m = self.config.network, self.config.length_m, self.config.motion_m
        sets = [
            particle_set(*parts, size, length_m=length_m, motion_m=motion_m)
            for parts in zip(states, actions, frames, strict=True)
        ]
        moved = self._moved(sets)
        return [self._advance(*parts) for parts in zip(states, actions, frames, sets, moved, strict=True)]

    def _moved(self, sets: list[ParticleSet]) -> list[Tensor]:
        """Let the network predict the displacement of the object's particles, [M, 3] each, in units of `motion_m`."""
        if isinstance(self.network, ParticleTransformer):
            return [self.network(each.positions, each.features)[: each.objects] for each in sets]
        size = self.config.network
        assert isinstance(size, GraphConfig)
        edges, first = [], 0
        for each in sets:
            own = radius_edges(each.positions, each.objects, size.radius, size.neighbours)
            edges.append(Edges(own.senders + first, own.receivers + first))
            first += len(each.positions)
        joined = Edges(torch.cat([e.senders for e in edges]), torch.cat([e.receivers for e in edges]))
        positions, features = torch.cat([s.positions for s in sets]), torch.cat([s.features for s in sets])
        parts = self.network(positions, features, joined).split([len(s.positions) for s in sets])
        return [part[: each.objects] for part, each in zip(parts, sets, strict=True)]

    def _advance(
        self, state: ParticleState, action: ToolStep, frame: StepFrame, seen: ParticleSet, moved: Tensor
    ) -> ParticleState:
        """Move the Gaussians with their particles."""
        gaussians, size = state.gaussians, self.config.network
        bones = gaussians.means[seen.chosen]
        shift = moved @ (frame.rotation.T * self.config.motion_m)
        turns = local_turns(bones, bones + shift)
        if len(bones) == len(gaussians):
            means = bones + shift
        else:
            weights = skin_weights(gaussians.means, bones, size.bones)
            means, turns = skinned(gaussians.means, bones, bones + shift, turns, weights)
        after = gaussians.with_(
            means=means, quats=nn.functional.normalize(quat_multiply(turns, gaussians.quats), dim=-1)
        )
        side = advance_sides(state.side, means, action)
        return ParticleState(
            after, means - gaussians.means, rotation_vector_from_quat(turns), side, has_history=True, rest=state.rest
        )
