"""Rigid motion of Gaussians: the world may turn together with the camera and nothing changes in the image."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera, look_at
from plop.geometry.rigid import invert_rigid
from plop.render.rasterizer.rasterize import render
from plop.render.rasterizer.sh import sh_to_rgb
from plop.render.rigid_motion import moved_rigidly, rotated_sh

POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()
POSE[:3, 3] = [0.02, -0.01, 0.03]


def blob(terms: int) -> Gaussians:
    draw = torch.Generator().manual_seed(0)
    count = 12
    quats = torch.nn.functional.normalize(torch.randn(count, 4, generator=draw), dim=-1)
    return Gaussians(
        0.02 * torch.randn(count, 3, generator=draw),
        quats,
        0.002 + 0.01 * torch.rand(count, 3, generator=draw),
        torch.rand(count, generator=draw),
        0.3 * torch.randn(count, terms, 3, generator=draw),
        torch.arange(count),
    )


@pytest.mark.parametrize("terms", [1, 4, 9, 16])
def test_colours_turn_with_the_body(terms):
    sh, turn = blob(terms).sh.double(), torch.from_numpy(POSE[:3, :3])
    directions = torch.nn.functional.normalize(torch.randn(12, 3, dtype=torch.float64), dim=-1)
    assert torch.allclose(sh_to_rgb(rotated_sh(sh, turn), directions @ turn.T), sh_to_rgb(sh, directions), atol=1e-10)


@pytest.mark.parametrize("terms", [1, 16])
def test_a_camera_that_moves_along_sees_the_same(terms):
    intrinsics = np.array([[60.0, 0, 16], [0, 60, 16], [0, 0, 1]])
    seen_from = look_at(np.array([0.0, -0.2, 0.1]), np.zeros(3), np.array([0.0, 0, 1]))
    before = render(blob(terms), Camera("c", 32, 32, intrinsics, seen_from), backend="torch")
    after = render(moved_rigidly(blob(terms), POSE), Camera("c", 32, 32, intrinsics, POSE @ seen_from), backend="torch")
    assert torch.allclose(before.rgb, after.rgb, atol=1e-4)
    assert torch.allclose(before.depth_m, after.depth_m, atol=1e-4)


def test_there_and_back_is_where_it_was():
    start = blob(9)
    back = moved_rigidly(moved_rigidly(start, POSE), invert_rigid(POSE))
    for name in ("means", "covariances", "sh"):
        assert torch.allclose(getattr(back, name), getattr(start, name), atol=1e-6)
