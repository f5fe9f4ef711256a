"""A surface moved outwards: boxes grow by the distance on each side, spheres in radius."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from plop.geometry.meshes.thickened import thickened
from tests.support.box import BOX_FACES

BOX = np.array([[x, y, z] for x in (0, 0.06) for y in (0, 0.004) for z in (0, 0.05)], float)


@pytest.mark.parametrize("distance_m", [0.003, -0.0015, 0.0])
def test_a_box_grows_on_each_side(distance_m):
    grown = thickened(BOX, BOX_FACES, distance_m)
    np.testing.assert_allclose(grown, BOX + distance_m * np.sign(BOX - BOX.mean(0)), atol=1e-12)


def test_corners_that_are_not_shared_move_together():
    soup, faces = BOX[BOX_FACES].reshape(-1, 3), np.arange(3 * len(BOX_FACES)).reshape(-1, 3)
    np.testing.assert_allclose(
        thickened(soup, faces, 0.003), thickened(BOX, BOX_FACES, 0.003)[BOX_FACES].reshape(-1, 3)
    )


def test_a_round_tool_grows_in_radius():
    ball = trimesh.creation.icosphere(3, 0.02)
    radii = np.linalg.norm(thickened(np.asarray(ball.vertices), np.asarray(ball.faces), 0.002), axis=1)
    np.testing.assert_allclose(radii, 0.022, rtol=2e-3)


def test_what_was_thickened_is_thinned_again():
    wedge = trimesh.creation.cone(0.01, 0.04, sections=12)
    vertices, faces = np.asarray(wedge.vertices), np.asarray(wedge.faces)
    np.testing.assert_allclose(thickened(thickened(vertices, faces, 0.001), faces, -0.001), vertices, atol=2e-4)
