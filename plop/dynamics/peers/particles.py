"""The particles that a peer's network sees in one step: points of the object and of the tool near it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from plop.dynamics.i2n.features import rigid_displacement
from plop.dynamics.i2n.tool_frame import StepFrame
from plop.dynamics.interface import ParticleState, ToolStep
from plop.dynamics.peers.sampling import farthest_points
from plop.dynamics.peers.settings import SampledConfig
from plop.geometry.clouds.neighbours import nearest

FEATURES = 7
"""Object, tool (one-hot) 2, motion 3, whether it is known 1, height above the table 1."""
_TOOL_CANDIDATES = 600
"""Points on the tool's surface among which those near the object are sampled, as many as I2N sees."""


@dataclass(frozen=True)
class ParticleSet:
    """Particles of one step, the object's first."""

    positions: Tensor
    """In the frame of the step, in lengths of the object, shape [M + K, 3]."""
    features: Tensor
    """Shape [M + K, FEATURES]."""
    objects: int
    """M."""
    chosen: Tensor
    """Row of the Gaussian that each particle of the object is, shape [M], int64."""


def particle_set(
    state: ParticleState, action: ToolStep, frame: StepFrame, config: SampledConfig, *, length_m: float, motion_m: float
) -> ParticleSet:
    """Sample object and tool, and encode what is known of each particle.

    Args:
        state: The Gaussians.
        action: The tool's motion.
        frame: Frame of the network's input.
        config: Numbers of particles.
        length_m: Size of the object, unit of positions [m].
        motion_m: Typical motion in a step, unit of displacements [m].

    Returns:
        The particles. A particle of the object has its motion of the last step, one of the tool that of this step.
    """
    chosen = farthest_points(state.gaussians.means, config.particles)
    means = state.gaussians.means[chosen]
    tool = _tool_points(means, action, config, length_m)
    moves = torch.cat([state.last_translation[chosen], rigid_displacement(tool, action)])
    places = frame.points_in(torch.cat([means, tool])) / length_m
    known = places.new_full((len(places), 1), 1.0)
    known[: len(means)] = float(state.has_history)
    kind = places.new_zeros(len(places), 2)
    kind[: len(means), 0] = 1
    kind[len(means) :, 1] = 1
    height = places[:, 2:].clamp(-1, 1)
    features = torch.cat([kind, frame.vectors_in(moves) / motion_m, known, height], dim=1)
    return ParticleSet(places, features, len(means), chosen)


def _tool_points(means: Tensor, action: ToolStep, config: SampledConfig, length_m: float) -> Tensor:
    """Spread points over the part of the tool that is near the object, world, shape [K, 3] [m]; K may be 0."""
    pose = action.world_from_tool.to(means)
    points = action.tool.surface_points(_TOOL_CANDIDATES).to(means) @ pose[:3, :3].T + pose[:3, 3]
    distance = nearest(means, 1, queries=points)[0][:, 0]
    points = points[distance <= config.tool_reach * length_m]
    return points[farthest_points(points, config.tool_points)]
