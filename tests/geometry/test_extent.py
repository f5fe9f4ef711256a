"""An object's size does not depend on how it lies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plop.geometry.meshes.convex import convex_surface
from plop.geometry.meshes.extent import box_edges_m

CORNERS = np.array([[x, y, z] for x in (-0.04, 0.04) for y in (-0.025, 0.025) for z in (0, 0.04)])


@pytest.mark.parametrize("turn_deg", [(0, 0, 0), (0, 0, 45), (20, -50, 70)])
def test_a_box_gets_its_own_edges(turn_deg):
    turned = CORNERS @ Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix().T + [0.3, -0.2, 0.1]
    np.testing.assert_allclose(box_edges_m(*convex_surface(turned)), [0.08, 0.05, 0.04], rtol=1e-3)


def test_a_ball_gets_the_box_of_its_moments():
    points = np.random.default_rng(0).normal(size=(4000, 3))
    points *= 0.05 / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(box_edges_m(*convex_surface(points)), 0.05 * np.sqrt(12 / 5), rtol=0.01)
