import numpy as np
import torch
from torch.testing import assert_close

from plop.geometry.rigid import quat_to_matrix
from plop.recordings.recording import View
from stages.fit_init.held_out import choose_held_out
from stages.fit_init.shell import (
    Surface,
    carved,
    farthest_points,
    quats_along,
    seed_gaussians,
    seen_by,
    surface_from_views,
)
from tests.support.ellipsoid_scene import CENTER, RADII, ellipsoid_distance, render, ring


def views(count: int = 4, size: int = 64) -> list[View]:
    return [View(camera, *render(camera)) for camera in ring(count, size)]


def outward(points: np.ndarray) -> np.ndarray:
    normals = (points - CENTER) / RADII**2
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_depth_images_give_the_surface_with_outward_normals():
    surface = surface_from_views(views())
    assert np.abs(ellipsoid_distance(surface.points)).max() < 1e-4
    alignment = (surface.normals * outward(surface.points)).sum(1)
    assert np.median(alignment) > 0.98 and (alignment > 0).mean() > 0.98


def test_seeds_are_flat_along_the_surface_and_evenly_spread():
    surface = surface_from_views(views())
    seeds = seed_gaussians(surface, 300, opacity=0.9, overlap=0.5, flatness=2.5)
    normals = quat_to_matrix(seeds.quats)[:, :, 2].numpy()
    assert np.median((normals * outward(seeds.means.numpy())).sum(1)) > 0.98
    assert_close(seeds.scales[:, 0] / seeds.scales[:, 2], torch.full((300,), 2.5))
    gaps = torch.cdist(seeds.means, seeds.means).fill_diagonal_(1).amin(1)
    assert gaps.max() < 2.5 * gaps.min()


def test_farthest_points_leave_no_gap():
    points = np.random.default_rng(0).uniform(0, 1, (2000, 3))
    chosen = points[farthest_points(points, 100)]
    cover = np.linalg.norm(points[:, None] - chosen, axis=-1).min(1).max()
    apart = np.linalg.norm(chosen[:, None] - chosen + 9 * np.eye(100)[..., None], axis=-1).min()
    assert cover <= apart + 1e-6, "the property that defines the order"


def test_rotations_turn_the_third_axis_to_the_normal():
    normals = torch.nn.functional.normalize(torch.randn(50, 3, generator=torch.Generator().manual_seed(0)), dim=1)
    normals = torch.cat([normals, torch.eye(3), -torch.eye(3)])
    assert_close(quat_to_matrix(quats_along(normals))[:, :, 2], normals, rtol=1e-4, atol=1e-5)


def test_carving_keeps_the_inside_and_drops_what_views_see_through():
    inside = CENTER + 0.5 * RADII * np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 0.5], [0, 0, 0]])
    outside = CENTER + 1.2 * RADII * np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert carved(inside, views(), 0.002).tolist() == [False] * 4
    assert carved(outside, views(), 0.002).tolist() == [True] * 3


def test_a_point_on_the_far_side_is_not_seen():
    view = views(1)[0]
    eye = view.camera.world_from_cam[:3, 3]
    toward = np.append(eye[:2] / np.linalg.norm(eye[:2]), 0)
    points = np.stack([CENTER + 0.999 * sign * toward / np.linalg.norm(toward / RADII) for sign in (1, -1)])
    assert seen_by(points, [view], 0.003).tolist() == [True, False]


def test_the_view_that_alone_sees_a_side_is_not_held_out():
    around = views(8)
    # Three neighbours on one side and one opposite: only the opposite one sees its side.
    chosen = [around[0], around[1], around[2], around[5]]
    training, held = choose_held_out(chosen, 1)
    assert len(training) == 3 and len(held) == 1
    assert held[0] is not around[5] and any(view is around[5] for view in training)
    assert len(choose_held_out(chosen[:2], 1)[0]) == 2, "two views always train"


def test_a_subset_keeps_rows_together():
    surface = Surface(np.arange(9.0).reshape(3, 3), np.ones((3, 3)), np.zeros((3, 3)))
    assert surface.select(np.array([2])).points.tolist() == [[6, 7, 8]]
