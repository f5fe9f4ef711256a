"""Time offsets and the poses of a scan: known answers come back, and what cannot be told is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.calibration.bundle_adjust import align_poses, refine_scan
from plop.geometry.calibration.time_offset import offset_by_search
from plop.geometry.cameras import Camera, look_at
from plop.geometry.rigid import pose_from_euler_xyz


def test_search_finds_a_minimum_and_admits_when_there_is_none():
    found = offset_by_search(lambda t: 1 + abs(t - 0.013), max_offset_s=0.1, step_s=0.02)
    assert found is not None and found[0] == pytest.approx(0.013, abs=2e-3)
    assert offset_by_search(lambda t: t, max_offset_s=0.1, step_s=0.02) is None


def textured_room(count=6):
    """Photograph a noisy floor with a box on it; gives cameras, images, depths."""
    matrix = np.array([[420.0, 0, 160], [0, 420, 120], [0, 0, 1]])
    lattice = np.random.default_rng(5).random((64, 64, 64, 3))
    cameras, images, depths = [], [], []
    for angle in np.linspace(-0.35, 0.35, count):
        eye = np.array([0.5 * np.sin(angle), -0.5 * np.cos(angle), 0.4 + 0.1 * np.sin(4 * angle)])
        camera = Camera("wrist", 320, 240, matrix, look_at(eye, np.array([0, 0, 0.02]), np.array([0, 0, 1.0])))
        rows, columns = np.mgrid[0:240, 0:320]
        rays = np.stack([(columns - 159.5) / 420, (rows - 119.5) / 420, np.ones(rows.shape)], -1)
        direction = rays @ camera.world_from_cam[:3, :3].T
        floor = -eye[2] / direction[..., 2]
        with np.errstate(divide="ignore"):
            low = (np.array([-0.06, -0.05, 0]) - eye) / direction
            high = (np.array([0.06, 0.05, 0.07]) - eye) / direction
        near, far = np.minimum(low, high).max(-1), np.maximum(low, high).min(-1)
        depth = np.where((near < far) & (near > 0), np.minimum(near, floor), floor)
        points = (eye + depth[..., None] * direction)[..., :3]
        color = sum(_noise(lattice, points / size) * weight for size, weight in ((0.02, 0.5), (0.006, 0.5)))
        cameras.append(camera)
        images.append((255 * np.clip(color, 0, 1)).astype(np.uint8))
        depths.append(depth.astype(np.float32))
    return cameras, images, depths


def _noise(lattice, points):
    cell = np.floor(points).astype(int)
    part = points - cell
    total = np.zeros(points.shape)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, part, 1 - part), axis=-1, keepdims=True)
        index = (cell + corner) % 64
        total += weight * lattice[index[..., 0], index[..., 1], index[..., 2]]
    return total


@pytest.fixture(scope="module")
def room():
    return textured_room()


def noisy(cameras, metres=0.006, radians=0.01):
    draw = np.random.default_rng(1)
    out = []
    for camera in cameras:
        wobble = pose_from_euler_xyz(np.r_[metres * draw.normal(size=3), radians * draw.normal(size=3)])
        pose = camera.world_from_cam.copy()
        pose[:3, :3] = wobble[:3, :3] @ pose[:3, :3]
        pose[:3, 3] += wobble[:3, 3]
        out.append(replace(camera, world_from_cam=pose))
    return out


def relative_error_mm(poses, cameras):
    """Distance of camera centres after the best rigid fit: the world's own place is not the scan's to find."""
    true = np.stack([camera.world_from_cam for camera in cameras])
    scale, rotation, shift = align_poses(poses, true, scale=1.0)
    return np.median(np.linalg.norm(poses[:, :3, 3] @ rotation.T + shift - true[:, :3, 3], axis=1)) * 1e3


@pytest.mark.parametrize("source", ["poses", "depth"])
def test_scan_poses_are_refined_at_metric_scale(room, source):
    cameras, images, depths = room
    given = noisy(cameras)
    found = refine_scan(images, given, scale_from=source, depths_m=depths)
    assert found.placed.all() and found.reprojection_px < 1.0
    before = relative_error_mm(np.stack([camera.world_from_cam for camera in given]), cameras)
    after = relative_error_mm(found.world_from_cam, cameras)
    assert after < (0.8 if source == "depth" else 0.6 * before) and before > 3
    if source == "depth":
        span = np.linalg.norm(found.world_from_cam[0, :3, 3] - found.world_from_cam[-1, :3, 3])
        true = np.linalg.norm(cameras[0].world_from_cam[:3, 3] - cameras[-1].world_from_cam[:3, 3])
        assert span == pytest.approx(true, rel=5e-3)


def test_a_scan_without_texture_is_refused(room):
    cameras, images, _ = room
    blank = [np.full_like(image, 128) for image in images[:3]]
    with pytest.raises(PlopError):
        refine_scan(blank, cameras[:3])


def test_unpaired_or_short_scans_are_refused(room):
    cameras, images, depths = room
    for arguments in ((images[:2], cameras), (images[:2], cameras[:2])):
        with pytest.raises(PlopError):
            refine_scan(*arguments)
    with pytest.raises(PlopError, match="source"):
        refine_scan(images, cameras, scale_from="depth")


def test_cameras_that_stand_still_give_no_scale():
    still = np.tile(np.eye(4), (4, 1, 1))
    with pytest.raises(PlopError, match="stand still"):
        align_poses(still, still)
