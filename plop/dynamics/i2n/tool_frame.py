"""The frame of the network's input: it turns with the tool about the vertical.

A dynamics model must not depend on where on the table, or in which heading, an experiment takes place.
Expressing a step in a frame under the tool, with its heading, makes this exact instead of
learned. `world` turns it off (the paper's form).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from plop.dynamics.interface import ToolStep


@dataclass(frozen=True)
class StepFrame:
    """A frame with a vertical z axis: x_world = rotation @ x_frame + origin."""

    rotation: Tensor
    """Orthogonal, shape [3, 3]; may include a reflection when data are augmented."""
    origin: Tensor
    """Shape [3] [m]."""

    def points_in(self, points: Tensor) -> Tensor:
        """World points to the frame, [..., 3] -> [..., 3] [m]."""
        return (points - self.origin) @ self.rotation

    def vectors_in(self, vectors: Tensor) -> Tensor:
        """World vectors to the frame."""
        return vectors @ self.rotation

    @property
    def handedness(self) -> Tensor:
        """+1, or -1 for a reflection, under which rotation vectors change sign."""
        return torch.det(self.rotation)

    def reflected(self, across_x: bool, across_y: bool) -> StepFrame:
        """The mirrored frame, for augmentation."""
        signs = self.rotation.new_tensor([-1.0 if across_x else 1.0, -1.0 if across_y else 1.0, 1.0])
        return StepFrame(self.rotation * signs, self.origin)


def tool_frame(action: ToolStep) -> StepFrame:
    """Return the frame under the tool, turned to its heading.

    x is the horizontal direction of the tool's shortest axis (a blade's normal); where that axis is
    vertical (a press plate), of its longest. The origin is the tool's centre at the start of the step,
    at the height of the table (0 without one).
    """
    pose = action.world_from_tool
    axes = pose[:3, :3] @ action.tool.axes.to(pose)
    normal = axes[:, 0] if axes[2, 0].abs() < 0.9 else axes[:, 2]
    x = normal * normal.new_tensor([1.0, 1.0, 0.0])
    x = x / x.norm().clamp_min(1e-9)
    up = x.new_tensor([0.0, 0.0, 1.0])
    rotation = torch.stack([x, torch.linalg.cross(up, x), up], dim=1)
    center = pose[:3, :3] @ action.tool.center.to(pose) + pose[:3, 3]
    height = 0.0 if action.table_z_m is None else action.table_z_m
    return StepFrame(rotation, torch.stack([center[0], center[1], center.new_tensor(height)]))


def world_frame(action: ToolStep) -> StepFrame:
    """The world itself, origin moved to the table's height."""
    pose = action.world_from_tool
    height = 0.0 if action.table_z_m is None else action.table_z_m
    return StepFrame(torch.eye(3, dtype=pose.dtype, device=pose.device), pose.new_tensor([0.0, 0.0, height]))
