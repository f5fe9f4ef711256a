"""What a particle tells the network about itself (PLOP, Eq. 16-17).

`paper`: opacity, log-volume (the paper's det(S S^T) spans ten decades), motion of the last step and a flag
that it exists. `contact` adds what decides the motion near a tool: the place relative to the tool, the tool's
motion at this place, the side of the cut, and the height above the table.
"""

from __future__ import annotations

import math
from typing import Literal

import torch
from torch import Tensor

from plop.dynamics.frames import StepFrame
from plop.dynamics.interface import ParticleState, ToolStep
from plop.geometry.rigid import matrix_to_quat, rotation_vector_from_quat

FeatureSet = Literal["paper", "contact"]
OBJECT_FEATURES: dict[str, int] = {"paper": 9, "contact": 23}
TOOL_FEATURES = 8


def tool_rotation_vector(action: ToolStep) -> Tensor:
    """Rotation of the tool over the step as a rotation vector in the action's frame, shape [3] [rad]."""
    turn = action.next_world_from_tool[:3, :3] @ torch.linalg.inv(action.world_from_tool[:3, :3])
    return rotation_vector_from_quat(matrix_to_quat(turn))


def rigid_displacement(points: Tensor, action: ToolStep) -> Tensor:
    """Displacement that points would have if they moved with the tool, columns [3, N] -> [3, N] [m]."""
    change = action.next_world_from_tool @ torch.linalg.inv(action.world_from_tool)
    still = torch.eye(3, dtype=change.dtype, device=change.device)
    return torch.addmm(change[:3, 3:], change[:3, :3] - still, points)


def object_features(
    state: ParticleState, seen: ToolStep, frame: StepFrame, place: Tensor, carried: Tensor, *, length_m: float,
    motion_m: float, kind: FeatureSet,
) -> Tensor:  # fmt: skip
    """Encode the object's particles.

    Args:
        state: The particles.
        seen: The tool's motion in this step, in the frame.
        frame: The frame in which the network sees the step.
        place: The particles in the frame, shape [3, N] [m].
        carried: What they would move by with the tool, shape [3, N] [m].
        length_m: Size of the object, unit of places [m].
        motion_m: Typical motion in a step, unit of displacements [m].
        kind: Which features.

    Returns:
        Features of order 1, shape [OBJECT_FEATURES[kind], N].
    """
    gaussians = state.gaussians
    axes = gaussians.scales.clamp_min(1e-9).unbind(-1)
    log_volume = (axes[0] * axes[1] * axes[2]).log()[None] - 3 * math.log(length_m / 30)
    rows = [
        gaussians.opacities[None],
        log_volume / 3,
        frame.vectors_in(state.last_translation) / motion_m,
        frame.vectors_in(state.last_rotation) * (frame.handedness * 10),
        torch.full_like(log_volume, float(state.has_history)),
    ]
    if kind == "contact":
        rows += _contact_features(state.side, seen, place, carried, length_m, motion_m)
    return torch.cat(rows)


def _contact_features(
    side: Tensor, seen: ToolStep, place: Tensor, carried: Tensor, length_m: float, motion_m: float
) -> list[Tensor]:
    center, axes = seen.tool.placed(seen.world_from_tool.to(place))
    half = seen.tool.half_extent.to(place)
    local = axes.T @ (place - center[:, None])
    outside = (local.abs() - half[:, None]).clamp_min(0) * local.sign()
    # Kept from 0, where a root has no derivative.
    distance = outside.square().sum(0, keepdim=True).clamp_min(1e-20).sqrt()
    return [
        place / length_m,
        axes @ outside / length_m,
        torch.exp(-distance / (0.1 * length_m)),
        torch.exp(-distance / (0.03 * length_m)),
        carried / motion_m,
        # The side is told along the frame's x axis, so that it means the same in a mirrored frame.
        (side * axes[0, 0].sign())[None],
        ((center[2] - half.max()) / length_m).expand(1, len(side)),
        (place[2:] - center[2]) / length_m,
    ]


def tool_features(points: Tensor, seen: ToolStep, *, motion_m: float) -> Tensor:
    """Encode points of the tool: presence, its motion and its rotation in this step.

    Args:
        points: Points of the tool, in the frame, shape [3, M] [m].
        seen: The step, in the frame.
        motion_m: Unit of displacements [m].

    Returns:
        Shape [TOOL_FEATURES, M].
    """
    ones = torch.ones_like(points[:1])
    turn = tool_rotation_vector(seen).to(points) * 10
    moved = rigid_displacement(points, seen) / motion_m
    return torch.cat([ones, moved, turn[:, None].expand_as(points), ones * (seen.dt_s * 10)])
