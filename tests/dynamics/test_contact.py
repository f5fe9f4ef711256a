"""What a pressing tool covers gives way to it; a blade is no obstacle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial import ConvexHull

from plop.dynamics.filter.particle_filter import UpdateConfig, update
from plop.dynamics.filter.tool_contact import SolidTool
from plop.dynamics.interface import at_rest
from plop.dynamics.losses.physical import Neighbourhood
from plop.geometry.cameras import Camera, look_at
from plop.geometry.meshes.tool import ToolGeometry
from plop.render.losses import Target
from plop.render.rasterizer.rasterize import render
from tests.dynamics.conftest import blade, pose
from tests.support.small_episode import SIZE, coloured_block

TOP_M, PRESSED_M = 0.03, 0.004


def plate(half: float = 0.04, height: float = 0.03) -> ToolGeometry:
    """A plate of 80 x 80 x 30 mm above its origin, turned by 30 degrees in its own frame."""
    corners = np.array([[x, y, z] for x in (-half, half) for y in (-half, half) for z in (0.0, height)])
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    corners = corners @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    return ToolGeometry.from_mesh(corners, ConvexHull(corners).simplices)


def test_depth_is_the_distance_to_the_nearest_face_and_zero_outside():
    tool = plate()
    assert tool.hull.shape == (6, 4)
    points = torch.tensor([[0.0, 0.0, 0.002], [0.0, 0.0, 0.027], [0.0, 0.0, -0.001], [0.2, 0.0, 0.005]])
    assert tool.depth_inside(points).tolist() == pytest.approx([0.002, 0.003, 0, 0], abs=1e-6)


def test_overlap_is_seen_in_the_world_and_pulls_outwards():
    solid = SolidTool.of(plate(), pose(0.1, 0.2, 0.3, yaw=0.4))
    assert solid is not None
    inside = torch.tensor([[0.1, 0.2, 0.303], [0.1, 0.2, 0.2]], requires_grad=True)
    overlap = solid.overlap_m(inside)
    overlap.backward()
    assert float(overlap) == pytest.approx(0.0015, abs=1e-6)
    assert torch.allclose(inside.grad, torch.tensor([[0.0, 0.0, 0.5], [0.0, 0.0, 0.0]]), atol=1e-5)


def test_a_blade_is_no_obstacle_nor_are_two_fingers():
    assert SolidTool.of(blade(), torch.eye(4)) is None
    finger = plate(0.01, 0.05)
    assert finger.filled == pytest.approx(1, abs=1e-5)
    corners = [finger.vertices.numpy() + [offset, 0, 0] for offset in (-0.04, 0.04)]
    gripper = ToolGeometry.from_mesh(np.concatenate(corners), np.concatenate([finger.faces, finger.faces + 8]))
    assert gripper.filled < 0.5 and SolidTool.of(gripper, torch.eye(4)) is None


def updated(contact: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Update a block under a plate that only a camera below it sees; gives the means before and after."""
    block = coloured_block(600)
    middle = np.array([0.03, 0.02, 0.0])
    camera = Camera(
        "below",
        SIZE,
        SIZE,
        np.array([[70.0, 0, SIZE / 2], [0, 70.0, SIZE / 2], [0, 0, 1]]),
        look_at(middle - [0.0, 0.001, 0.12], middle, np.array([0.0, 1.0, 0.0])),
    )
    seen = render(block, camera)
    everywhere = torch.ones(SIZE, SIZE, dtype=torch.bool)
    target = Target(camera, seen.rgb.detach(), seen.depth_m.detach(), seen.alpha.detach() > 0.5, everywhere)
    state = replace(at_rest(block), has_history=True)
    tool = SolidTool.of(plate(), pose(0.03, 0.02, TOP_M - PRESSED_M))
    found = update(
        state,
        block,
        [target],
        Neighbourhood.of(block.means),
        0.06,
        UpdateConfig(iterations=30, views=1, contact=contact),
        tool,
    )
    return block.means, found.gaussians.means


def test_what_no_camera_sees_leaves_the_tool():
    before, alone = updated(0.0)
    _, pressed = updated(1.0)
    covered, low = before[:, 2] > TOP_M - PRESSED_M + 0.001, before[:, 2] < 0.008
    deep = (before[covered, 2] - (TOP_M - PRESSED_M)).mean()
    assert (alone[covered, 2] - (TOP_M - PRESSED_M)).mean() > 0.8 * deep
    assert (pressed[covered, 2] - (TOP_M - PRESSED_M)).clamp_min(0).mean() < 0.4 * deep
    assert (pressed[low] - before[low]).norm(dim=-1).mean() < 0.0006
