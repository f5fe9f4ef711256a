"""Initial scene of a prediction: the object and the tool of an episode's first frame."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from plop.artifacts.layouts import Fit
from plop.dynamics.initial_surface import initial_surface
from plop.dynamics.interface import ToolStep
from plop.gaussians.splat_ply import read_splat
from plop.gaussians.state import Gaussians
from plop.geometry.meshes.tool import ToolGeometry
from plop.recordings.recording import Recording


@dataclass(frozen=True)
class InitialScene:
    """Object, tool and table at the first frame; the start of a planner, and the reference of its actions."""

    gaussians: Gaussians
    """The object, world frame."""
    tool: ToolGeometry
    """The tool's form, in its own frame."""
    table_z_m: float | None = None
    """Height of the table [m]; None when there is none."""
    surface: tuple[np.ndarray, np.ndarray] | None = None
    """The object's closed surface where it was measured, vertices [V, 3] [m] and triangles [F, 3]; without it the
    convex hull of the Gaussians is used."""
    tool_gaussians: Gaussians | None = None
    """How the tool looks, in its own frame; None where nothing is rendered."""

    @classmethod
    def of(
        cls, recording: Recording, fitted: str | os.PathLike[str], device: torch.device | str = "cpu"
    ) -> InitialScene:
        """Read the first frame of a recording and the Gaussians that were fitted to it.

        Args:
            recording: The episode.
            fitted: Artifact of `fit-init`, or its folder.
            device: Device of the Gaussians; a learned model expects them on its own device.

        Raises:
            PlopError: The episode was not fitted, or a file is damaged.
        """
        folder = Path(fitted) / recording.name
        gaussians, tool = (read_splat(path).to(device) for path in (Fit(folder).object_splat, Fit(folder).tool_splat))
        mesh = recording.tool_mesh
        return cls(
            gaussians,
            ToolGeometry.from_mesh(mesh.vertices, mesh.faces).to(device),
            recording.table_z_m,
            initial_surface(recording, gaussians),
            tool,
        )

    def action(
        self, world_from_tool: np.ndarray | Tensor, next_world_from_tool: np.ndarray | Tensor, dt_s: float
    ) -> ToolStep:
        """Return the action that moves the tool from one pose to another.

        Args:
            world_from_tool: Pose at the start of the step, shape [4, 4].
            next_world_from_tool: Pose at its end, shape [4, 4].
            dt_s: Duration [s].
        """
        before, after = (
            torch.as_tensor(pose, dtype=torch.float32, device=self.gaussians.means.device)
            for pose in (world_from_tool, next_world_from_tool)
        )
        return ToolStep(self.tool, before, after, dt_s, self.table_z_m)
