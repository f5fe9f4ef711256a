"""What a tool is does not depend on the grid, and it is no wider than its faces."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from plop.physics.engine.kernels.tool_contact import facing, solid_height, tool_gap
from plop.physics.engine.surface_normals import outward_normals
from plop.physics.engine.tool_motion import ToolKind, ToolShape
from plop.physics.scenes.tools import blade_mesh, box_mesh, cylinder_mesh

NONE = np.zeros(4, np.float32)


def gap(shape: ToolShape, point: tuple[float, float, float], reach: float) -> float:
    """Distance from a point of the tool's own frame [m]."""
    local = (np.array(point) - shape.center) @ shape.axes
    d, y, z = (np.float32(v) for v in local)
    return float(tool_gap(2, shape.faces, NONE, d, y, z, 0, False, np.float32(reach))[0])


def test_proportions_tell_a_blade_from_a_punch():
    assert ToolShape.from_mesh(*blade_mesh()).kind == ToolKind.BLADE
    assert ToolShape.from_mesh(*cylinder_mesh(0.014, 0.02)).kind == ToolKind.SOLID
    assert ToolShape.from_mesh(*box_mesh((0.020, 0.035, 0.028))).kind == ToolKind.SOLID
    assert ToolShape.from_mesh(*box_mesh((0.020, 0.035, 0.028)), ToolKind.BLADE).kind == ToolKind.BLADE


@pytest.mark.parametrize("reach", [0.002, 0.004])
def test_particles_beside_a_punch_are_not_pressed(reach: float):
    punch = ToolShape.from_mesh(*box_mesh((0.024, 0.024, 0.020)))
    below = -0.8 * reach
    assert gap(punch, (0.0, 0.0, below), reach) == pytest.approx(0.8 * reach, abs=1e-6)
    assert gap(punch, (0.0115, 0.0, below), reach) == pytest.approx(0.8 * reach, abs=1e-6)
    assert gap(punch, (0.0125, 0.0, below), reach) > 1, "past the edge, though nearer to it than its reach"
    assert gap(punch, (0.0125, 0.0, 0.005), reach) == pytest.approx(0.0005, abs=1e-6), "its side wall pushes"


def test_a_round_wall_has_no_gaps_between_its_facets():
    radius, reach = 0.014, 0.003
    punch = ToolShape.from_mesh(*cylinder_mesh(radius, 0.02))
    for angle in np.linspace(0, 2 * np.pi, 97):
        place = (radius + 0.9 * reach) * np.array([np.cos(angle), np.sin(angle)])
        assert gap(punch, (*place, 0.01), reach) < reach


def test_at_an_edge_the_tool_pushes_against_the_surface_as_far_as_its_faces_allow():
    punch = ToolShape.from_mesh(*box_mesh((0.024, 0.024, 0.020)))
    place = (np.array([0.0115, 0.0, 0.002]) - punch.center) @ punch.axes

    def pushed(outward: tuple[float, float, float], near: float) -> np.ndarray:
        d, y, z = (np.float32(v) for v in place)
        normal = np.array(outward) @ punch.axes
        return punch.axes @ np.array(facing(punch.faces, d, y, z, np.float32(near), *map(np.float32, normal)))

    assert pushed((0, 0, 1), 0.005) == pytest.approx([0, 0, -1], abs=1e-5), "a top before the side wall goes under"
    assert pushed((-1, 0, 0), 0.005) == pytest.approx([1, 0, 0], abs=1e-5), "a side is pushed aside"
    tilted = np.array([-0.6, 0, 0.8])
    assert pushed((*tilted,), 0.005) == pytest.approx(-tilted, abs=1e-5), "between two faces, straight against it"
    part = np.array([0.6, 0, -0.48]) / 0.768375
    assert pushed((-0.6, 0.64, 0.48), 0.005) == pytest.approx(part, abs=1e-5), "the part that they allow"
    assert pushed((0.6, 0, 0.8), 0.005) == pytest.approx([0, 0, -1], abs=1e-5), "no face looks that way"
    assert pushed((0, 0, 0), 0.005) == pytest.approx([1, 0, 0], abs=1e-5), "within the material, the nearest face"
    assert pushed((0, 0, 1), 0.0005) == pytest.approx([1, 0, 0], abs=1e-5), "what is deep below counts no more"


def test_normals_are_those_of_the_surface_before_it_deformed():
    side = np.arange(5) * 0.01
    cube = np.stack(np.meshgrid(side, side, side, indexing="ij"), -1).reshape(-1, 3)
    volumes = np.full(len(cube), 1e-6)
    stretched = np.diag([1.2, 1.0, 0.9]) @ np.array([[1, 0.2, 0], [0, 1, 0], [0, 0, 1.0]])
    found = outward_normals(cube @ stretched.T, np.tile(stretched, (len(cube), 1, 1)), volumes)
    within = ((cube > 0.005) & (cube < 0.035)).all(1)
    assert not found[within].any()
    assert np.abs(np.linalg.norm(found[~within], axis=1) - 1).max() < 1e-5
    top = (np.abs(cube[:, :2] - 0.02) < 0.005).all(1) & (cube[:, 2] > 0.035)
    assert found[top] == pytest.approx(np.array([[0.0, 0.0, 1.0]]), abs=0.05)


def test_far_from_a_tool_of_many_faces_a_few_of_them_show_it():
    """`solid_height` may stop at the first face that is far enough away: what touches must not depend on that."""
    vertices = np.random.default_rng(0).normal(size=(300, 3))
    vertices *= [0.02, 0.01, 0.015] / np.linalg.norm(vertices, axis=1, keepdims=True)
    shape = ToolShape.from_mesh(vertices, ConvexHull(vertices).simplices, ToolKind.SOLID)
    places = np.random.default_rng(1).uniform(-0.03, 0.03, (2000, 3)).astype(np.float32)
    heights = places @ shape.faces[:, :3].T - shape.faces[:, 3]
    reach = np.float32(0.003)
    found = np.array([solid_height(shape.faces, *place, reach)[0] for place in places])
    near = heights.max(1) <= reach
    assert np.allclose(found[near], heights.max(1)[near], atol=1e-7)
    assert (found[~near] > reach).all()
    asked = (heights > reach).argmax(1)[~near]
    assert len(shape.faces) > 400
    assert asked.mean() < 10, "on average; close to the tool it may take all"
