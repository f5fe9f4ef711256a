"""The tool as Gaussians: without holes and as wide as its mesh, down to a thin cutting edge."""

import numpy as np
import pytest
import torch

from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera, look_at
from plop.geometry.rigid import pose_from_euler_xyz, transform_points
from plop.recordings.recording import Mesh
from plop.render.rasterizer.sh import C0
from plop.render.scene import render_scene
from stages.fit_init.tool_splats import drawn_in, sample_mesh, splats_on

LENGTH_M, HEIGHT_M, THICK_M = 0.12, 0.03, 0.002
INTRINSICS = np.array([[100.0, 0, 48], [0, 100, 48], [0, 0, 1]])
SIDE = Camera(
    "side", 96, 96, INTRINSICS, look_at(np.array([0.0, -0.15, 0.015]), np.array([0.0, 0, 0.015]), np.array([0.0, 0, 1]))
)


def wedge() -> Mesh:
    """A blade whose two sides meet in a cutting edge at z = 0."""
    x, y = LENGTH_M / 2, THICK_M / 2
    corners = [[-x, 0, 0], [x, 0, 0], [-x, -y, HEIGHT_M], [x, -y, HEIGHT_M], [-x, y, HEIGHT_M], [x, y, HEIGHT_M]]
    faces = [[0, 1, 3], [0, 3, 2], [0, 4, 5], [0, 5, 1], [2, 3, 5], [2, 5, 4], [0, 2, 4], [1, 5, 3]]
    return Mesh(np.array(corners), np.array(faces))


@pytest.mark.parametrize("count", [1500, 3000])
def test_a_blade_is_drawn_whole_and_no_wider_than_it_is(count):
    points, normals = sample_mesh(drawn_in(wedge(), count), count, seed=0)
    tool = splats_on(points, normals, np.full((count, 3), 0.5))
    (view,) = render_scene(tool.select(torch.zeros(0, dtype=torch.int64)), tool, [SIDE])
    rows, columns = np.mgrid[:96, :96] + 0.5
    x, z = (columns - 48) / 100 * 0.15, 0.015 - (rows - 48) / 100 * 0.15
    pixel = 0.15 / 100
    inner = (np.abs(x) < LENGTH_M / 2 - pixel) & (z > pixel) & (z < HEIGHT_M - pixel)
    outer = (np.abs(x) < LENGTH_M / 2 + pixel) & (z > -pixel) & (z < HEIGHT_M + pixel)
    whole = (np.abs(x) < LENGTH_M / 2) & (z > 0) & (z < HEIGHT_M)
    assert view.tool_mask[inner].all()
    assert not view.tool_mask[~outer].any()
    assert view.tool_mask.sum() == pytest.approx(whole.sum(), rel=0.06)
    assert view.rgb[inner].mean() == pytest.approx(128, abs=5)
    assert view.rgb[inner].min() > 90


def test_points_lie_on_the_mesh_with_the_normals_of_their_faces():
    points, normals = sample_mesh(wedge(), 400, seed=1)
    assert (np.linalg.norm(normals, axis=1)) == pytest.approx(1)
    sides = np.abs(normals[:, 1]) > 0.9
    off = np.abs(points[sides, 1]) - THICK_M / 2 * points[sides, 2] / HEIGHT_M
    assert np.abs(off).max() < 1e-9
    assert sides.mean() > 0.8


def test_a_tool_is_drawn_in_where_splats_lie_side_by_side_and_stays_as_thin_as_it_is():
    turned = pose_from_euler_xyz(np.array([0.3, -0.1, 0.2, 0.4, 0.2, 1.1]))
    mesh = Mesh(transform_points(turned, wedge().vertices), wedge().faces)
    inside = transform_points(np.linalg.inv(turned), drawn_in(mesh, 3000).vertices)
    small = np.ptp(inside, axis=0) / [LENGTH_M, THICK_M, HEIGHT_M]
    assert small[1] == pytest.approx(1, abs=1e-4)
    assert 0.97 < small[0] < 0.995 and 0.9 < small[2] < 0.98
    assert LENGTH_M * (1 - small[0]) == pytest.approx(HEIGHT_M * (1 - small[2]), rel=1e-3)
    assert inside.mean(0) == pytest.approx(wedge().vertices.mean(0), abs=1e-3)


def test_a_single_splat_has_a_size():
    tool = splats_on(np.zeros((1, 3)), np.array([[0.0, 0, 1]]), np.full((1, 3), 0.5))
    assert isinstance(tool, Gaussians)
    assert torch.isfinite(tool.scales).all() and (tool.scales > 0).all()
    assert ((tool.sh[:, 0] * C0 + 0.5) - 0.5).abs().max() < 1e-6
