"""Cameras around a box whose top is parallel to its table: each hides parts of the table that the others see."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from plop.geometry.calibration.depth_agreement import DepthView, disagreement
from plop.geometry.cameras import Camera
from tests.support.ellipsoid_scene import ring

BOX = np.array([[-0.05, -0.03, 0.0], [0.05, 0.03, 0.04]])


def seen(camera: Camera, shift: np.ndarray | None = None, noise_m: float = 0.0) -> DepthView:
    """Trace box and table exactly, the region within 50 mm of the box; `shift` [m] displaces what is measured."""
    eye = camera.world_from_cam[:3, 3] + (0 if shift is None else shift)
    directions = camera.pixel_directions() @ camera.world_from_cam[:3, :3].T
    table = -eye[2] / directions[..., 2]
    near, far = np.sort((BOX[:, None, None] - eye) / directions, axis=0)
    enter, leave = near.max(-1), far.min(-1)
    box = (enter < leave) & (enter > 0)
    depth = np.where(box, enter, table)
    depth = depth + noise_m * np.random.default_rng(camera.width).normal(size=depth.shape)
    points = eye + depth[..., None] * directions
    region = ((points >= BOX[0] - 0.05) & (points <= BOX[1] + 0.05)).all(-1)
    return DepthView(camera, depth, region, box)


@pytest.mark.parametrize("noise_m", [0.0, 0.001])
def test_what_a_box_hides_is_no_disagreement(noise_m):
    for a, b in combinations(ring(6), 2):
        found = disagreement([(seen(a, noise_m=noise_m), seen(replace(b, name="b"), noise_m=noise_m))])
        assert found.shown_mm < 0.5


@pytest.mark.parametrize("shift_mm", [3.0, 10.0, 25.0])
def test_a_camera_that_is_displaced_disagrees_with_all(shift_mm):
    """By 0.8 of it upwards, which is 1.4 times as much along a ray that meets the table at 35 degrees."""
    cameras = ring(6)
    shift = 1e-3 * shift_mm * np.array([0.6, 0.0, 0.8])
    for other in cameras[1:]:
        found = disagreement([(seen(cameras[0], shift), seen(other))])
        assert 1.2 * shift_mm < found.shown_mm < 1.8 * shift_mm
