"""The closed surface around measured points: volume, noise, table, orientation."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from plop.errors import PlopError
from plop.geometry.meshes.convex import convex_surface

SIZE_M = np.array([0.08, 0.05, 0.04])


def box_points(count: int, *, noise_m: float = 0.0, table_z_m: float = 0.0, underside: bool = False) -> np.ndarray:
    """Sample the surface of a box on a table, without what the table hides."""
    box = trimesh.creation.box(SIZE_M, trimesh.transformations.translation_matrix([0, 0, SIZE_M[2] / 2]))
    points = np.asarray(trimesh.sample.sample_surface(box, count, seed=0)[0])
    if not underside:
        points = points[points[:, 2] > 1e-6]
    return points + [0, 0, table_z_m] + np.random.default_rng(1).normal(0, noise_m, points.shape)


def volume(surface: tuple[np.ndarray, np.ndarray]) -> float:
    mesh = trimesh.Trimesh(*surface, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent
    return float(mesh.volume)


def test_exact_points_give_their_hull():
    corners = np.array([[x, y, z] for x in (0, 0.08) for y in (0, 0.05) for z in (0, 0.04)])
    surface = convex_surface(np.concatenate([corners, corners.mean(0)[None]]))
    assert volume(surface) == pytest.approx(SIZE_M.prod(), rel=1e-6)
    assert len(surface[0]) == 8


@pytest.mark.parametrize("table_z_m", [0.0, 0.3, -0.2])
@pytest.mark.parametrize("noise_m", [0.0, 2e-4, 5e-4])
def test_noise_draws_the_surface_in_to_the_right_volume(noise_m, table_z_m):
    surface = convex_surface(box_points(4000, noise_m=noise_m, table_z_m=table_z_m), table_z_m)
    assert volume(surface) == pytest.approx(SIZE_M.prod(), rel=0.05)
    assert surface[0][:, 2].min() == pytest.approx(table_z_m, abs=2e-4)  # it stands on the table, wherever that is


def test_the_hull_of_noisy_points_would_be_too_large():
    points = box_points(4000, noise_m=5e-4, underside=True)
    assert trimesh.convex.convex_hull(points).volume > 1.05 * SIZE_M.prod()
    assert volume(convex_surface(points)) == pytest.approx(SIZE_M.prod(), rel=0.05)


def test_faces_look_outwards():
    vertices, faces = convex_surface(box_points(300), 0.0)
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (((corner.mean(1) - vertices.mean(0)) * normal).sum(1) > -1e-12).all()


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.zeros((9, 3)), np.eye(3).repeat(3, 0)])
def test_points_that_enclose_nothing_are_refused(points):
    with pytest.raises(PlopError, match="enclose no volume"):
        convex_surface(points)


@pytest.mark.parametrize("noise_m", [0.0, 5e-4])
def test_points_inside_the_surface_are_moved_onto_what_was_measured(noise_m):
    inside = box_points(2000) * (1 - 0.0014 / SIZE_M) + [0, 0, 0.0002]  # 0.7 mm inside on every side
    measured = box_points(8000, noise_m=noise_m)
    within = convex_surface(inside, 0.0)
    onto = convex_surface(inside, 0.0, measured)
    assert volume(within) < 0.95 * SIZE_M.prod()
    assert volume(onto) == pytest.approx(SIZE_M.prod(), rel=0.01)
    assert np.ptp(onto[0], axis=0) == pytest.approx(SIZE_M, abs=3e-4)


def test_each_side_is_moved_by_its_own_distance():
    inside = box_points(2000)
    inside[inside[:, 0] > 0.0399, 0] -= 0.001
    onto = convex_surface(inside, 0.0, box_points(8000, noise_m=3e-4))
    assert onto[0][:, 0].max() == pytest.approx(0.04, abs=3e-4)
    assert onto[0][:, 0].min() == pytest.approx(-0.04, abs=3e-4)


def test_a_handful_of_measured_points_moves_nothing():
    inside = box_points(2000)
    kept = convex_surface(inside, 0.0, box_points(20, noise_m=1e-3))
    assert volume(kept) == pytest.approx(volume(convex_surface(inside, 0.0)), rel=1e-9)
