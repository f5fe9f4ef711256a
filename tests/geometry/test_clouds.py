"""Clouds: files, averaging, outliers, planes, agreement, registration, distance volumes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.calibration.bundle_adjust import interpolate_depth
from plop.geometry.calibration.depth_agreement import DepthView, disagreement
from plop.geometry.calibration.local_planes import local_planes
from plop.geometry.cameras import Camera
from plop.geometry.clouds.cloud_ply import read_cloud, write_cloud
from plop.geometry.clouds.plane import find_plane
from plop.geometry.clouds.pointcloud import (
    PointCloud,
    check_metres,
    cloud_from_depth,
    join,
    largest_clusters,
    outlier_free,
    surface_distance_m,
    voxel_average,
)
from plop.geometry.clouds.registration import register
from plop.geometry.clouds.tsdf import fuse_tsdf
from plop.geometry.rigid import pose_from_euler_xyz
from plop.geometry.view import View
from tests.support.ellipsoid_scene import ellipsoid_distance, render, ring


def random_cloud(count=500, seed=0):
    draw = np.random.default_rng(seed)
    normals = draw.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return PointCloud(draw.uniform(-0.1, 0.1, (count, 3)), normals, draw.integers(0, 256, (count, 3)).astype(np.uint8))


def views(cameras):
    return [(camera, *render(camera)) for camera in cameras]


def test_ply_round_trip(tmp_path):
    cloud = random_cloud()
    write_cloud(tmp_path / "a.ply", cloud)
    back = read_cloud(tmp_path / "a.ply")
    np.testing.assert_allclose(back.points, cloud.points, atol=1e-8)
    np.testing.assert_allclose(back.normals, cloud.normals, atol=1e-6)
    np.testing.assert_array_equal(back.colors, cloud.colors)


def test_ply_agrees_with_trimesh(tmp_path):
    import trimesh

    cloud = random_cloud()
    write_cloud(tmp_path / "a.ply", cloud)
    np.testing.assert_allclose(trimesh.load(tmp_path / "a.ply").vertices, cloud.points, atol=1e-7)


def test_ascii_ply_without_normals_is_read(tmp_path):
    text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\n"
    (tmp_path / "a.ply").write_text(text + "end_header\n0 1 2\n3 4 5\n")
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.ply").points, [[0, 1, 2], [3, 4, 5]])


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"hello",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 9\n"
        b"property float x\nproperty float y\nproperty float z\nend_header\n1234",
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        b"property float z\nend_header\nnan 0 0\n",
    ],
)
def test_damaged_ply_is_explained(tmp_path, content):
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(PlopError, match="a.ply"):
        read_cloud(tmp_path / "a.ply")


def test_averaging_keeps_the_mean_and_one_point_a_voxel():
    cloud = random_cloud(5000)
    small = voxel_average(cloud, 0.02)
    assert len(small) == len(np.unique(np.floor(small.points / 0.02), axis=0)) < 1400
    np.testing.assert_allclose(np.linalg.norm(small.normals, axis=1), 1, atol=1e-9)
    cells, count = np.unique(np.floor(cloud.points / 0.02), axis=0, return_counts=True)
    np.testing.assert_allclose((small.points * count[:, None]).sum(0), cloud.points.sum(0), atol=1e-9)
    assert len(cells) == len(small)


def test_outliers_and_small_clusters_go():
    sphere = np.random.default_rng(0).normal(size=(2000, 3))
    sphere *= 0.05 / np.linalg.norm(sphere, axis=1, keepdims=True)
    stray = np.array([[0.2, 0, 0], [0, 0.15, 0.1]])
    cloud = PointCloud(np.vstack([sphere, stray]), np.zeros((2002, 3)), np.zeros((2002, 3), np.uint8))
    keep = outlier_free(cloud, deviations=4)
    assert not keep[-2:].any() and keep[:-2].mean() > 0.97
    assert not largest_clusters(cloud.points, 0.02)[-2:].any()


def test_the_table_is_found():
    draw = np.random.default_rng(0)
    table = np.column_stack([draw.uniform(-0.5, 0.5, (3000, 2)), 0.1 + 0.001 * draw.normal(size=3000)])
    plane = find_plane(np.vstack([table, draw.uniform(0.1, 0.3, (1000, 3))]))
    assert plane.normal[2] > 0.9999 and plane.offset_m == pytest.approx(0.1, abs=2e-4)
    with pytest.raises(PlopError):
        find_plane(np.zeros((5, 3)))


def test_millimetres_and_negative_depth_are_refused():
    check_metres(np.zeros((4, 4)), "empty")
    with pytest.raises(PlopError, match="millimetres"):
        check_metres(np.full((4, 4), 500.0), "a")
    with pytest.raises(PlopError, match="negative"):
        check_metres(np.full((4, 4), -0.5), "a")


def test_right_cameras_agree_and_a_shift_is_measured():
    (a, _, depth_a, mask), (b, _, depth_b, _) = views(ring(12))[:2]
    whole = mask >= 0
    source, target = DepthView(a, depth_a, mask == 1, mask == 1), DepthView(b, depth_b, whole, mask == 1)
    good = disagreement([(source, target)])
    assert good.compared > 500 and good.difference_mm < 0.3 and good.ratio == pytest.approx(1, abs=1e-3)
    farther = disagreement([(source, replace(target, depth_m=np.where(depth_b > 0, depth_b + 0.01, 0)))])
    assert farther.bias_mm == pytest.approx(10, abs=0.3) and farther.shown_mm == pytest.approx(10, rel=0.2)
    nothing = disagreement([(source, replace(target, depth_m=np.zeros_like(depth_b)))])
    assert nothing.compared == 0 and np.isnan(nothing.difference_mm)


@pytest.mark.parametrize("noise_m", [0.0, 0.003])
def test_local_planes_are_the_surface_and_end_at_edges(noise_m):
    camera = Camera("a", 96, 80, np.array([[120.0, 0, 47], [0, 118, 41], [0, 0, 1]]), np.eye(4))
    plane = np.array([0.4, -0.7, 2.0])
    depth = 1 / (camera.pixel_directions() @ plane)
    depth[:, 60:] += 0.1
    depth += np.random.default_rng(0).normal(scale=noise_m, size=depth.shape)
    depth[::9, ::7] = 0
    found = local_planes(camera, depth, depth > 0)
    first = found.vectors[:, : 55 // found.step].reshape(-1, 3)
    known = first[np.isfinite(first[:, 0])]
    assert len(known) > 0.6 * len(first)
    angles = np.arccos((known @ plane / np.linalg.norm(known, axis=1) / np.linalg.norm(plane)).clip(-1, 1))
    assert np.sqrt(np.mean(angles**2)) < 1e-6 + (0.3 if noise_m else 0)
    assert (found.window_px > 3) == bool(noise_m)
    assert np.isnan(found.vectors[:, 60 // found.step, 0]).all()


def test_interpolation_is_exact_on_a_ramp_and_refuses_holes():
    rows, columns = np.mgrid[0:8, 0:8]
    ramp = 1 + 0.01 * (columns + 0.5) + 0.02 * (rows + 0.5)
    pixels = np.array([[3.2, 4.7], [0.5, 0.5], [7.9, 2.0]])
    value = interpolate_depth(ramp, pixels, 0.1)
    np.testing.assert_allclose(value[:2], 1 + 0.01 * pixels[:2, 0] + 0.02 * pixels[:2, 1])
    assert np.isnan(value[2])
    ramp[4, 3] = 0
    assert np.isnan(interpolate_depth(ramp, pixels, 0.1)[0])


def clouds(cameras):
    """Take what lies within 0.15 m of the object, thinned out."""
    full = [cloud_from_depth(c, depth, rgb, depth > 0) for c, rgb, depth, _ in views(cameras)]
    return [voxel_average(cloud[np.linalg.norm(cloud.points, axis=1) < 0.15], 0.004) for cloud in full]


def test_registration_undoes_a_known_motion():
    given = clouds(ring(6))
    move = pose_from_euler_xyz(np.array([0.004, -0.006, 0.005, 0.02, -0.01, 0.015]))
    given[3] = given[3].moved(move)
    found = register(given, gate_m=0.03, fixed=[0, 1, 2, 4, 5])
    assert found.residual_after_mm <= found.residual_before_mm
    np.testing.assert_array_equal(found.corrections[0], np.eye(4))
    rest = found.corrections[3] @ move
    middle = np.array([0, 0, 0.03, 1])
    assert np.linalg.norm((rest @ middle - middle)[:3]) < 1e-3 and np.linalg.norm(rest[:3, :3] - np.eye(3)) < 0.01


def test_registration_of_right_clouds_changes_nothing_much():
    found = register(clouds(ring(4)), gate_m=0.02)
    assert np.abs(found.corrections - np.eye(4)).max() < 2e-3


def test_registration_without_overlap_or_with_nan():
    near, far = random_cloud(), random_cloud()
    far = PointCloud(far.points + 5, far.normals, far.colors)
    found = register([near, far], gate_m=0.02)
    assert found.pairs == 0 and np.isnan(found.residual_after_mm)
    np.testing.assert_array_equal(found.corrections, np.tile(np.eye(4), (2, 1, 1)))
    bad = replace(near, points=near.points * np.nan)
    with pytest.raises(PlopError, match="not finite"):
        register([near, bad], gate_m=0.02)
    assert register([near, join([])], gate_m=0.02).pairs == 0


def test_volume_gives_the_surface_and_its_frames_lie_on_it():
    frames = [View(c, rgb, np.where(mask == 1, depth, 0), mask) for c, rgb, depth, mask in views(ring(10))]
    cloud = fuse_tsdf(frames, 0.002)
    distance = np.abs(ellipsoid_distance(cloud.points))
    assert len(cloud) > 2000 and np.median(distance) < 3e-4
    frame = frames[0]
    residual = surface_distance_m(frame.camera.back_project(frame.depth_m), cloud, 0.02)
    assert len(residual) > 500 and np.median(np.abs(residual)) < 3e-4
    assert len(surface_distance_m(np.full((3, 3), 9.0), cloud, 0.02)) == 0


def test_volume_of_nothing_is_an_error():
    camera, rgb, depth, mask = views(ring(1))[0]
    with pytest.raises(PlopError, match="nothing to fuse"):
        fuse_tsdf([View(camera, rgb, 0 * depth, mask)], 0.002)
