"""The laws of sensor faults: what is recorded can be undone, and what a user types is read or refused."""

from __future__ import annotations

import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.cameras import look_at
from plop.geometry.rigid import invert_rigid
from plop.sensors.faults.library import FAULTS, Faults, frame_share, parse_faults

POSE = look_at(np.array([0.3, 0.1, 0.2]), np.zeros(3), np.array([0, 0, 1.0]))
DEPTH = np.array([[0.3, 0.0], [0.5, 1.2]], np.float32)


def test_a_clock_that_is_late_shows_an_earlier_scene():
    faults = parse_faults(["clock=0.02"])
    assert faults.true_time("cam_00", 1.0) == pytest.approx(0.98)
    assert faults.true_time("cam_01", 1.0) == 1.0


def test_drift_starts_at_nothing_and_ends_with_all():
    faults = parse_faults(["pose_drift.z_m=0.003@b", "pose_drift.rz_rad=0.01@b"], ["a", "b"])
    first, last = (faults.true_pose("b", frame_share(frame, 5), POSE) for frame in (0, 4))
    np.testing.assert_array_equal(first, POSE)
    np.testing.assert_allclose(last[:3, 3] - POSE[:3, 3], 0.003 * POSE[:3, 2], atol=1e-12)
    step = invert_rigid(POSE) @ last
    assert np.arctan2(step[1, 0], step[0, 0]) == pytest.approx(0.01)


def test_depth_faults_come_in_order():
    faults = parse_faults(["depth_bias=0.003", "depth_scale=1.01"])
    recorded = faults.depth("cam_00", DEPTH)
    np.testing.assert_allclose(recorded, np.where(DEPTH > 0, 1.01 * DEPTH + 0.003, 0), rtol=1e-6)
    assert recorded.dtype == np.float32 and (faults.depth("cam_01", DEPTH) == DEPTH).all()


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_with_its_defaults_is_absent(name):
    fault = FAULTS[name]()
    assert fault.true_time(0.7) == 0.7
    np.testing.assert_allclose(fault.true_pose(1.0, POSE), POSE, atol=1e-15)
    np.testing.assert_array_equal(fault.depth(DEPTH), DEPTH)
    assert fault.help and fault.law and fault.source and all(p.unit for p in fault.parameters)


def test_a_star_means_all_cameras():
    faults = parse_faults(["clock=0.02@*"], ["a", "b"])
    assert set(faults.by_camera) == {"a", "b"} and faults.as_dict()["b"]["clock"]["offset_s"] == 0.02
    assert not Faults({"a": []})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("clok=0.02", "no such sensor fault"),
        ("clock", "cannot be read"),
        ("clock=soon", "cannot be read"),
        ("clock=3", "out of range"),
        ("depth_scale=nan", "out of range"),
        ("pose_drift.a=1", "no such parameter"),
        ("clock=0.01@z", "camera that does not exist"),
    ],
)
def test_what_cannot_be_is_refused(text, message):
    with pytest.raises(PlopError, match=message):
        parse_faults([text], ["a", "b"])


def test_one_parameter_cannot_have_two_values():
    with pytest.raises(PlopError, match="given twice"):
        parse_faults(["clock=0.01", "clock=0.02@cam_00"])
