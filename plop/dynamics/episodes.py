"""Parts of a recording that dynamics needs: the tool's steps and the measured views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from plop.dynamics.interface import ToolStep
from plop.geometry.meshes.tool import ToolGeometry
from plop.recordings.recording import Recording
from plop.render.losses import Target, target_from_view


@dataclass(frozen=True)
class Actions:
    """The tool's motion through one episode."""

    tool: ToolGeometry
    world_from_tool: Tensor
    """Shape [T, 4, 4], float32."""
    time_s: np.ndarray
    """Shape [T] [s]."""
    table_z_m: float | None

    @classmethod
    def of(cls, recording: Recording, device: torch.device | str = "cpu") -> Actions:
        """Read the actions of a recording; no image is read."""
        mesh = recording.tool_mesh
        poses = torch.as_tensor(recording.world_from_tool, dtype=torch.float32, device=device)
        tool = ToolGeometry.from_mesh(mesh.vertices, mesh.faces).to(device)
        return cls(tool, poses, recording.time_s, recording.table_z_m)

    def __len__(self) -> int:
        """Number of frames; the number of steps is one less."""
        return len(self.time_s)

    def step(self, frame: int) -> ToolStep:
        """Return the step from one frame to the next."""
        dt = float(self.time_s[frame + 1] - self.time_s[frame])
        return ToolStep(self.tool, self.world_from_tool[frame], self.world_from_tool[frame + 1], dt, self.table_z_m)

    def steps(self) -> list[ToolStep]:
        """Return all steps, one between each pair of consecutive frames."""
        return [self.step(frame) for frame in range(len(self) - 1)]


def measured_views(
    recording: Recording, frame: int, cameras: list[str] | None = None, device: torch.device | str = "cpu"
) -> list[Target]:
    """Read the views of one frame that show the object.

    Args:
        recording: The episode.
        frame: Its frame.
        cameras: Names of the cameras; all when absent.
        device: Where the targets live.

    Returns:
        The views, without those in which no pixel shows the object.
    """
    found = []
    for name in cameras or recording.camera_names:
        view = recording.view(name, frame)
        if view.object_mask.any():
            found.append(target_from_view(view, device=device))
    return found
