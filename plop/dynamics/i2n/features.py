"""Input features of a particle (PLOP, Eq. 16-17).

`paper`: opacity, log-volume (the paper's det(S S^T) spans ten decades), motion of the last step and a flag
that it exists. `contact` adds what determines the motion near a tool: the position relative to the tool, the tool's
motion at this position, the side of the cut, and the height above the table. `oriented` adds the tool's motion mirrored
in the table's x axis.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from plop.dynamics.i2n.tool_frame import StepFrame
from plop.dynamics.interface import ParticleState, ToolStep
from plop.geometry.rigid import matrix_to_quat, rotation_vector_from_quat

FeatureSet = Literal["paper", "contact", "oriented"]
OBJECT_FEATURES: dict[str, int] = {"paper": 9, "contact": 23, "oriented": 25}
TOOL_FEATURES = 8


def tool_rotation_vector(action: ToolStep) -> Tensor:
    """Rotation of the tool over the step as a rotation vector in the world, shape [3] [rad]."""
    turn = action.next_world_from_tool[:3, :3] @ action.world_from_tool[:3, :3].T
    return rotation_vector_from_quat(matrix_to_quat(turn))


def rigid_displacement(points: Tensor, action: ToolStep) -> Tensor:
    """Displacement that world points would have if they moved with the tool, shape [N, 3] [m]."""
    change = action.next_world_from_tool @ torch.linalg.inv(action.world_from_tool)
    still = torch.eye(3, dtype=change.dtype, device=change.device)
    return torch.addmm(change[:3, 3], points, change[:3, :3].T - still)


def mirrored_in_table(vectors: Tensor) -> Tensor:
    """Mirror horizontal vectors in the table's x axis, that of the world; their height is dropped.

    A frame that turns with the tool does not show the orientation of a table with different friction along x and y:
    one of planks or with a weave, or a simulator's that limits friction along each axis separately. The mirror image
    shows it: an object that yields along one axis only moves by the mean of a push and its image. It is invariant
    under half a turn of the table, as such a table is.

    Args:
        vectors: Of the world, shape [..., 3].

    Returns:
        The same shape and unit.
    """
    return vectors * vectors.new_tensor([1.0, -1.0, 0.0])


def object_features(
    state: ParticleState,
    action: ToolStep,
    frame: StepFrame,
    with_tool: Tensor,
    place: Tensor,
    *,
    length_m: float,
    motion_m: float,
    kind: FeatureSet,
) -> Tensor:
    """Encode the object's particles.

    Args:
        state: The particles.
        action: The tool's motion in this step.
        frame: The frame of the network's input.
        with_tool: `rigid_displacement` of the particles, shape [N, 3] [m].
        place: Their positions in the frame, shape [N, 3] [m].
        length_m: Size of the object, unit of positions [m].
        motion_m: Typical motion in a step, unit of displacements [m].
        kind: Which features.

    Returns:
        Features of order 1, shape [N, OBJECT_FEATURES[kind]].
    """
    gaussians = state.gaussians
    sizes = (30 / length_m) * gaussians.scales
    log_volume = sizes.clamp_min(1e-6).prod(-1, keepdim=True).log()
    flag = torch.full_like(log_volume, float(state.has_history))
    columns = [
        gaussians.opacities[:, None],
        log_volume / 3,
        state.last_translation @ (frame.rotation / motion_m),
        state.last_rotation @ (frame.rotation * frame.handedness * 10),
        flag,
    ]
    if kind != "paper":
        # units and mirror image are folded into the 3 x 3 matrices, which leaves little work per particle
        turned = [frame.rotation, mirrored_in_table(frame.rotation.T).T[:, :2]][: 2 if kind == "oriented" else 1]
        moved = (with_tool @ (torch.cat(turned, dim=1) / motion_m)).split([3, 2][: len(turned)], dim=-1)
        columns += _contact_features(gaussians.means, state.side, action, frame, place, moved[0], length_m)
        columns += moved[1:]
    return torch.cat(columns, dim=-1)


def _contact_features(
    means: Tensor, side: Tensor, action: ToolStep, frame: StepFrame, place: Tensor, moved: Tensor, length_m: float
) -> list[Tensor]:
    pose = action.world_from_tool.to(means)
    center = pose[:3, :3] @ action.tool.center.to(means) + pose[:3, 3]
    axes = pose[:3, :3] @ action.tool.axes.to(means)
    local = torch.addmm(-(center @ axes), means, axes)
    half = action.tool.half_extent.to(means)
    outside = local - local.clamp(-half, half)
    # The side is signed along the frame's x axis, so that it means the same in a mirrored frame.
    normal_x = frame.vectors_in(axes[:, 0])[0].sign()
    distance = outside.norm(dim=-1, keepdim=True)
    return [
        place / length_m,
        outside @ (axes.T @ frame.rotation / length_m),
        torch.exp(distance * distance.new_tensor([-1 / (0.1 * length_m), -1 / (0.03 * length_m)])),
        moved,
        (side * normal_x)[:, None],
        (center[2] - half.max() - frame.origin[2]).expand(len(means), 1) / length_m,
        (place[:, 2:] + (frame.origin[2] - center[2])) / length_m,
    ]


def tool_features(points: Tensor, action: ToolStep, frame: StepFrame, *, motion_m: float) -> Tensor:
    """Encode points of the tool: presence, its motion and its rotation in this step.

    Args:
        points: World points of the tool, shape [M, 3] [m].
        action: The step.
        frame: The frame of the network's input.
        motion_m: Unit of displacements [m].

    Returns:
        Shape [M, TOOL_FEATURES].
    """
    ones = points.new_ones(len(points), 1)
    moved = frame.vectors_in(rigid_displacement(points, action)) / motion_m
    turn = frame.vectors_in(tool_rotation_vector(action).to(points)) * frame.handedness * 10
    return torch.cat([ones, moved, turn.expand(len(points), 3), ones * action.dt_s * 10], dim=-1)
