"""Virtual cameras with a wrong clock, a wrong pose, an arm in view."""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.view import MaskLabel
from plop.render.virtual_cameras.recorder import Disturbances, cameras_of, disturbed_render
from plop.render.virtual_cameras.settings import CameraSettings
from plop.sensors.faults.library import parse_faults
from tests.support.box_sequence import box_sequence

SETTINGS = CameraSettings(size=32, count=2, supersample=1)


def views(disturbances=Disturbances(), settings=SETTINGS):
    sequence = box_sequence()
    cameras = cameras_of(sequence, settings)
    with ExitStack() as stack:
        render = disturbed_render(sequence, cameras, settings, disturbances, stack)
        return {c.name: [render(frame, c) for frame in range(len(sequence))] for c in cameras}


def test_a_late_clock_shows_the_frame_before_and_the_others_are_right():
    right, late = views(), views(Disturbances(parse_faults(["clock=0.05"])))
    for frame, shown in ((0, 0), (1, 0), (2, 1)):
        np.testing.assert_allclose(late["cam_00"][frame].depth_m, right["cam_00"][shown].depth_m, atol=1e-6)
    assert (late["cam_00"][2].depth_m != right["cam_00"][2].depth_m).any()
    np.testing.assert_array_equal(late["cam_01"][2].rgb, right["cam_01"][2].rgb)


def test_a_pose_error_moves_the_picture_and_a_drift_grows():
    right = views()
    wrong = views(Disturbances(parse_faults(["pose_error.x_m=0.02"])))
    drifts = views(Disturbances(parse_faults(["pose_drift.x_m=0.02"])))
    assert (wrong["cam_00"][0].mask != right["cam_00"][0].mask).sum() > 20
    np.testing.assert_array_equal(drifts["cam_00"][0].mask, right["cam_00"][0].mask)
    np.testing.assert_array_equal(drifts["cam_00"][-1].mask, wrong["cam_00"][-1].mask)


def test_an_arm_hides_what_is_behind_it_and_is_undecided():
    clear, hidden = views()["cam_01"][0], views(Disturbances(arm_m=0.02))["cam_01"][0]
    arm = hidden.mask == MaskLabel.UNKNOWN
    assert arm.sum() > 10 and not (clear.mask == MaskLabel.UNKNOWN).any()
    assert ((hidden.depth_m < clear.depth_m) | (clear.depth_m == 0))[arm].all()
    np.testing.assert_array_equal(hidden.rgb[~arm], clear.rgb[~arm])


def test_colour_noise_has_the_size_that_was_asked_for():
    clean, noisy = views()["cam_00"][0].rgb, views(Disturbances(colour_noise=4.0))["cam_00"][0].rgb
    assert (noisy.astype(float) - clean).std() == pytest.approx(4.0, rel=0.1)


def test_blender_refuses_faults():
    settings = CameraSettings(size=32, count=2, renderer="blender")
    with pytest.raises(PlopError, match="Blender cannot"):
        views(Disturbances(parse_faults(["clock=0.05"])), settings)
