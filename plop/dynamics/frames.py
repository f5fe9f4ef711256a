"""The frame in which the network sees a step: it turns with the tool about the vertical.

A dynamics model must not depend on where on the table, or in which heading, an experiment takes place.
Expressing a step in a frame that sits under the tool and shares its heading makes this exact instead of
learned. `world` turns it off (the paper's form).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from plop.dynamics.interface import ToolStep


@dataclass(frozen=True)
class StepFrame:
    """A frame with a vertical z axis: x_world = rotation @ x_frame + origin.

    Inside the frame, points and vectors of N particles are the columns of a matrix, shape [3, N]: products with
    3x3 matrices and sums over the axes are several times faster so.
    """

    rotation: Tensor
    """Orthogonal, shape [3, 3]; may hold a reflection when data are augmented."""
    origin: Tensor
    """Shape [3] [m]."""

    def points_in(self, points: Tensor) -> Tensor:
        """World points to the frame, [N, 3] -> [3, N] [m]."""
        return torch.addmm(-(self.rotation.T @ self.origin)[:, None], self.rotation.T, points.T)

    def vectors_in(self, vectors: Tensor) -> Tensor:
        """World vectors to the frame, [N, 3] -> [3, N]."""
        return self.rotation.T @ vectors.T

    def vectors_out(self, vectors: Tensor) -> Tensor:
        """Vectors of the frame to the world, [3, N] -> [N, 3]."""
        return (self.rotation @ vectors).T.contiguous()

    def see(self, action: ToolStep) -> ToolStep:
        """Give a step with the tool's poses in this frame; mirrored poses where the frame is a reflection."""
        change = torch.eye(4, dtype=self.rotation.dtype, device=self.rotation.device)
        change[:3, :3], change[:3, 3] = self.rotation.T, -(self.rotation.T @ self.origin)
        before, after = (change @ pose.to(change) for pose in (action.world_from_tool, action.next_world_from_tool))
        return replace(action, world_from_tool=before, next_world_from_tool=after)

    @cached_property
    def handedness(self) -> Tensor:
        """+1, or -1 for a reflection, under which rotation vectors change sign."""
        return torch.linalg.det(self.rotation)

    def reflected(self, across_x: bool, across_y: bool) -> StepFrame:
        """The mirrored frame, for augmentation."""
        signs = self.rotation.new_tensor([-1.0 if across_x else 1.0, -1.0 if across_y else 1.0, 1.0])
        return StepFrame(self.rotation * signs, self.origin)


def tool_frame(action: ToolStep) -> StepFrame:
    """Sit under the tool, turned to its heading.

    x is the horizontal direction of the tool's shortest axis (a blade's normal); where that axis is
    vertical (a press plate), of its longest. The origin is the tool's centre at the start of the step,
    at the height of the table (0 without one).
    """
    center, axes = action.tool.placed(action.world_from_tool)
    normal = axes[:, 0] if axes[2, 0].abs() < 0.9 else axes[:, 2]
    x = normal * normal.new_tensor([1.0, 1.0, 0.0])
    x = x / x.norm().clamp_min(1e-9)
    up = x.new_tensor([0.0, 0.0, 1.0])
    rotation = torch.stack([x, torch.linalg.cross(up, x), up], dim=1)
    height = 0.0 if action.table_z_m is None else action.table_z_m
    return StepFrame(rotation, torch.stack([center[0], center[1], center.new_tensor(height)]))


def world_frame(action: ToolStep) -> StepFrame:
    """The world itself, origin moved to the table's height."""
    pose = action.world_from_tool
    height = 0.0 if action.table_z_m is None else action.table_z_m
    return StepFrame(torch.eye(3, dtype=pose.dtype, device=pose.device), pose.new_tensor([0.0, 0.0, height]))
