"""The plane under the object: where it is, whether it is flat, and what bends or turns it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.geometry.view import View
from plop.sensors.checks.support_plane import find_support, turned
from tests.support.droid_scene import EXT1, TABLE_Z, Scene, exterior_poses


def shot(focal: float = 60.0, noise_m: float = 0.0) -> View:
    scene = Scene(96, 72, focal)
    pose = exterior_poses()[EXT1]
    rgb, depth, mask = scene.render(pose, None)
    depth = depth + np.random.default_rng(0).normal(scale=noise_m or 1e-9, size=depth.shape).astype(np.float32)
    return View(scene.camera(pose), rgb, depth, mask)


def ray_length(view: View) -> np.ndarray:
    return np.linalg.norm(view.camera.pixel_directions(), axis=-1).astype(np.float32)


@pytest.mark.parametrize("focal", [50.0, 100.0])
@pytest.mark.parametrize("noise_m", [0.0, 0.002])
def test_a_table_is_found_where_it_is(focal, noise_m):
    plane = find_support(shot(focal, noise_m))
    assert plane is not None and plane.rests and not plane.is_far(TABLE_Z)
    assert plane.height_m == pytest.approx(TABLE_Z, abs=0.001) and plane.tilt_deg < 0.5
    assert not plane.bend.distance and not plane.bend.curved


@pytest.mark.parametrize("focal", [50.0, 70.0])
def test_distance_along_the_ray_bends_it_by_a_known_shape(focal):
    view = shot(focal, 0.002)
    plane = find_support(replace(view, depth_m=view.depth_m * ray_length(view)))
    assert plane is not None and plane.bend.distance and plane.bend.p == pytest.approx(1, abs=0.1)
    back = find_support(replace(view, depth_m=view.depth_m * ray_length(view)), as_distance=True)
    assert back is not None and back.height_m == pytest.approx(TABLE_Z, abs=0.001)


def test_depth_divided_by_the_ray_and_a_bent_lens_are_no_distance():
    view = shot(50.0)
    divided = find_support(replace(view, depth_m=view.depth_m / ray_length(view)))
    assert divided is None or (divided.bend.curved and not divided.bend.distance)


@pytest.mark.parametrize("factor", [0.95, 1.03])
def test_a_depth_scale_moves_it(factor):
    view = shot()
    plane = find_support(replace(view, depth_m=view.depth_m * factor))
    high = view.camera.world_from_cam[2, 3] - TABLE_Z
    assert plane is not None and plane.height_m - TABLE_Z == pytest.approx((1 - factor) * high, abs=0.003)


@pytest.mark.parametrize(("turns", "mirrored"), [(2, False), (2, True)])
def test_turned_pictures_see_it_far_off_and_turned_back_they_do_not(turns, mirrored):
    wrong = turned(shot(), turns, mirrored)
    plane = find_support(wrong)
    assert plane is not None and plane.is_far(TABLE_Z)
    back = find_support(turned(wrong, turns, mirrored))
    assert back is not None and not back.is_far(TABLE_Z)


def test_without_object_or_depth_there_is_none():
    view = shot()
    assert find_support(replace(view, mask=np.zeros_like(view.mask))) is None
    assert find_support(replace(view, depth_m=np.zeros_like(view.depth_m))) is None
