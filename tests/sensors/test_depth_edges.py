"""Depth against colour edges: aligned depth is not blamed, moved depth is measured, and else silence."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from plop.geometry.view import View
from plop.sensors.checks.depth_edges import depth_steps, edge_alignment, tolerance_px
from tests.support.droid_scene import EXT1, Scene, exterior_poses, flange_path, world_from_tool

SIZES = [(64, 48, 60.0), (160, 120, 140.0)]


def shot(width: int, height: int, focal: float, *, noise_m: float = 0.0) -> View:
    scene = Scene(width, height, focal)
    pose = exterior_poses()[EXT1]
    rgb, depth, mask = scene.render(pose, world_from_tool(flange_path(2))[0])
    rng = np.random.default_rng(0)
    depth = np.where(depth > 0, depth + rng.normal(scale=noise_m or 1e-9, size=depth.shape), 0).astype(np.float32)
    return View(scene.camera(pose), rgb, depth, mask)


def moved(view: View, zoom: float, dx: float, dy: float) -> View:
    """Depth that is to be zoomed and then moved by so much to lie on its picture."""
    height, width = view.depth_m.shape
    x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    place = zoom * x + width / 2 + dx - 0.5, zoom * y + height / 2 + dy - 0.5
    return replace(view, depth_m=cv2.remap(view.depth_m, *(p.astype(np.float32) for p in place), cv2.INTER_NEAREST))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("noise_m", [0.0, 0.002])
def test_depth_that_lies_on_its_picture_is_not_moved(size, noise_m):
    found = edge_alignment([shot(*size, noise_m=noise_m)])
    assert found is None or not found.moved(tolerance_px(size[0]))


@pytest.mark.parametrize(("zoom", "dx", "dy"), [(1.0, 6.0, 0.0), (1.0, -5.0, 3.0), (1.3, 0.0, 0.0), (0.8, 4.0, 0.0)])
def test_moved_depth_is_measured(zoom, dx, dy):
    found = edge_alignment([moved(shot(*SIZES[1]), zoom, dx, dy)])
    assert found is not None and found.moved(tolerance_px(160))
    assert found.zoom == pytest.approx(zoom, abs=0.04)
    assert (found.dx_px, found.dy_px) == pytest.approx((dx, dy), abs=1.5)


def test_a_picture_without_edges_tells_nothing():
    view = moved(shot(*SIZES[1]), 1.0, 6.0, 0.0)
    noise = np.random.default_rng(1).integers(0, 255, view.rgb.shape, dtype=np.uint8)
    for rgb in (np.full_like(view.rgb, 120), noise):
        found = edge_alignment([replace(view, rgb=rgb)])
        assert found is None or not found.moved(tolerance_px(160))


def test_a_steep_plane_and_a_crease_are_no_steps():
    rows = np.arange(60)[:, None] + np.zeros(80)
    steep = 1 / (0.6 + 0.04 * rows)
    assert len(depth_steps(steep, 80)) == 0
    crease = 1 / (1.0 + 0.02 * np.abs(rows - 30))
    assert len(depth_steps(crease, 80)) == 0
    step = np.where(rows < 30, 1.0, 0.7)
    points = depth_steps(step, 80)
    assert len(points) > 60 and np.allclose(points[:, 1], 30) and not points[:, 2].any()
    step[28:30] = 0
    assert len(depth_steps(step, 80)) > 60


def test_nothing_measured_is_nothing_told():
    view = shot(*SIZES[0])
    assert edge_alignment([replace(view, depth_m=np.zeros_like(view.depth_m))]) is None
    assert edge_alignment([replace(view, depth_m=np.full_like(view.depth_m, np.nan))]) is None
