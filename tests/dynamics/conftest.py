"""Small blocks, tools and steps for the tests of the dynamics."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from plop.dynamics.interface import ToolStep
from plop.gaussians.state import Gaussians
from plop.geometry.meshes.tool import ToolGeometry
from tests.support.box import BOX_FACES


def block_of(count: int, seed: int = 0) -> Gaussians:
    """A block of 60 x 40 x 30 mm filled at random."""
    generator = torch.Generator().manual_seed(seed)
    means = torch.rand(count, 3, generator=generator) * torch.tensor([0.06, 0.04, 0.03])
    quats = torch.nn.functional.normalize(torch.randn(count, 4, generator=generator), dim=-1)
    scales = 0.001 + 0.002 * torch.rand(count, 3, generator=generator)
    opacities = 0.3 + 0.6 * torch.rand(count, generator=generator)
    return Gaussians(means, quats, scales, opacities, torch.zeros(count, 1, 3), torch.arange(count))


def blade() -> ToolGeometry:
    """A blade of 2 x 80 x 40 mm: normal x, long axis y, height z."""
    corners = np.array([[x, y, z] for x in (-0.001, 0.001) for y in (-0.04, 0.04) for z in (0.0, 0.04)])
    faces = BOX_FACES
    return ToolGeometry.from_mesh(corners, faces)


def pose(x: float, y: float, z: float, yaw: float = 0.0) -> torch.Tensor:
    """A pose turned about the vertical."""
    out = torch.eye(4)
    c, s = np.cos(yaw), np.sin(yaw)
    out[:2, :2] = torch.tensor([[c, -s], [s, c]])
    out[:3, 3] = torch.tensor([x, y, z])
    return out


@pytest.fixture
def block() -> Gaussians:
    """400 Gaussians."""
    return block_of(400)


@pytest.fixture
def cut_step() -> ToolStep:
    """The blade goes down and sideways through the block's middle."""
    return ToolStep(blade(), pose(0.03, 0.02, 0.012), pose(0.032, 0.02, 0.009), 0.04, 0.0)
