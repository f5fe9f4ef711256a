"""Continuing what a tool hides down to the table, and not what is seen to end above it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import open3d as o3d
import pytest
import trimesh

from plop.geometry.cameras import Camera
from plop.geometry.convex import convex_surface
from plop.geometry.hidden_below import hidden_below
from tests.support.ellipsoid_scene import ring

SIZE_M = np.array([0.08, 0.05, 0.04])


def depth_image(camera: Camera, meshes: Sequence[trimesh.Trimesh]) -> tuple[np.ndarray, np.ndarray]:
    """Trace meshes on a table at height 0: depth [m], and which mesh is seen, -1 for the table."""
    scene = o3d.t.geometry.RaycastingScene()
    for mesh in meshes:
        scene.add_triangles(
            o3d.core.Tensor(mesh.vertices.astype(np.float32)), o3d.core.Tensor(mesh.faces.astype(np.uint32))
        )
    rays = camera.pixel_directions() @ camera.world_from_cam[:3, :3].T
    eye = np.broadcast_to(camera.world_from_cam[:3, 3], rays.shape)
    hit = scene.cast_rays(o3d.core.Tensor(np.concatenate([eye, rays], -1).astype(np.float32)))
    table = np.where(rays[..., 2] < 0, -eye[..., 2] / np.minimum(rays[..., 2], -1e-9), np.inf)
    depth = hit["t_hit"].numpy()
    return np.minimum(depth, table), np.where(depth < table, hit["geometry_ids"].numpy().astype(np.int64), -1)


def seen(meshes: Sequence[trimesh.Trimesh]) -> tuple[np.ndarray, list[tuple[Camera, np.ndarray]]]:
    """Give what a ring of cameras sees of the first mesh, and their depth, 0 where the others (tools) are."""
    points, views = [], []
    for camera in ring(6, size=128):
        depth, label = depth_image(camera, meshes)
        points.append(camera.back_project(np.where(label == 0, depth, 0)))
        views.append((camera, np.where(label > 0, 0, depth)))
    return np.concatenate(points), views


def box_with_pusher() -> tuple[np.ndarray, list[tuple[Camera, np.ndarray]]]:
    """See a box on a table; a tool around one end of it hides the lower edge there."""
    box = trimesh.creation.box(SIZE_M, trimesh.transformations.translation_matrix([0, 0, 0.02]))
    parts = (
        ([0.01, 0.09, 0.016], [-0.0465, 0, 0.01]),
        ([0.04, 0.01, 0.016], [-0.03, 0.0315, 0.01]),
        ([0.04, 0.01, 0.016], [-0.03, -0.0315, 0.01]),
    )
    return seen(
        [box, *(trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in parts)]
    )


def test_what_a_tool_hides_goes_down_to_the_table():
    points, views = box_with_pusher()
    corner = np.array([-0.04, 0.0, 0.0])
    assert np.linalg.norm(points - corner, axis=1).min() > 0.006  # the bar hides the edge
    rim = hidden_below(points, views, 0.0)
    assert (rim[:, 2] == 0).all()
    assert np.linalg.norm(rim - corner, axis=1).min() < 0.002
    assert np.abs(rim[:, 0]).max() < 0.0402 and np.abs(rim[:, 1]).max() < 0.0252

    def volume(*more: np.ndarray) -> float:
        return float(trimesh.Trimesh(*convex_surface(points, 0.0, points, *more), process=False).volume)

    assert volume() < 0.992 * SIZE_M.prod()
    assert volume(rim) == pytest.approx(SIZE_M.prod(), rel=0.003)


def test_what_is_seen_to_end_above_the_table_is_not_continued():
    ball = trimesh.creation.icosphere(4, 0.03)
    ball.apply_translation([0, 0, 0.03])
    points, views = seen([ball])
    rim = hidden_below(points, views, 0.0)
    assert np.linalg.norm(points[points[:, 2] < 0.03, :2], axis=1).max() > 0.029
    assert len(rim) == 0 or np.linalg.norm(rim[:, :2], axis=1).max() < 0.02


def test_without_cameras_nothing_is_known_to_end():
    points, _ = box_with_pusher()
    assert len(hidden_below(points, [], 0.0)) == int((points[:, 2] < 0.5 * points[:, 2].max()).sum())


def test_a_place_outside_an_image_or_without_depth_may_be_hidden():
    points, views = box_with_pusher()
    camera, depth = views[0]
    assert len(hidden_below(points, [(camera, np.zeros_like(depth))], 0.0)) == len(hidden_below(points, [], 0.0))
    assert len(hidden_below(points, [(camera, np.full_like(depth, np.nan))], 0.0)) == len(hidden_below(points, [], 0.0))
