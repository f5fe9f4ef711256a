"""What a tool is does not depend on the grid, and it is no wider than its faces."""

from __future__ import annotations

import numpy as np
import pytest

from plop.physics.engine.kernels.tool_contact import tool_gap
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
