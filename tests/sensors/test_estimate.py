"""Sensor faults are found, named and measured from table and tool; good cameras are left alone."""

from __future__ import annotations

import shutil

import h5py
import numpy as np
import pytest

from plop.recordings.readers.mesh.resample import resampled
from plop.recordings.recording import Recording
from plop.sensors.estimation.camera_frames import camera_scene, tool_track
from plop.sensors.estimation.estimate import estimate_sensors, pool
from plop.sensors.estimation.finding import State
from plop.sensors.estimation.fit import LEAST_SIGMA, fit_camera
from plop.sensors.estimation.parameters import COUNT, TOTAL
from plop.sensors.estimation.residuals import SYSTEMATIC_M, residuals
from plop.sensors.faults.library import FAULTS
from tests.sensors.conftest import CAMERAS, film

TRUE = {
    "cam_00": {"clock": {"offset_s": 0.02}},
    "cam_01": {"depth_scale": {"factor": 1.01}},
    "cam_02": {"depth_bias": {"offset_m": 0.003}, "pose_drift": {"ry_rad": 0.01746}},
    "cam_03": {"pose_drift": {"x_m": 0.003}},
    "cam_04": {},  # sees the blade edge-on
    "cam_05": {"clock": {"offset_s": -0.02}, "pose_error": {"z_m": 0.003}},
}
CLOSE = {"offset_s": 2e-3, "factor": 1e-3, "offset_m": 4e-4, "x_m": 8e-4, "ry_rad": 2e-3, "z_m": 8e-4}


@pytest.fixture(scope="module")
def found(faulty):
    return {finding.camera: finding for finding in estimate_sensors(faulty)}


@pytest.fixture(scope="module")
def good(lagging_object):
    return estimate_sensors(lagging_object)


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_faults_of_a_camera_are_found_and_nothing_else(found, camera):
    assert {each.fault for each in found[camera].found} == set(TRUE[camera])
    for each in found[camera].found:
        for key, value in TRUE[camera][each.fault].items():
            assert each.values[key] == pytest.approx(value, abs=CLOSE[key])
            assert 0 < each.standard_errors[key] < CLOSE[key]


def test_a_camera_that_sees_the_blade_edge_on_cannot_be_judged(found, good):
    assert found["cam_04"].state is State.CANNOT_BE_JUDGED
    assert [each.state for each in good if each.camera not in ("cam_01", "cam_04")] == [State.RIGHT] * 4
    assert {found[camera].state for camera in CAMERAS if TRUE[camera]} == {State.FAULTY}


def test_an_object_that_lags_is_no_fault_of_the_cameras(good):
    assert [(f.camera, each.fault) for f in good for each in f.found] == []
    for finding in good:
        assert finding.noise_m == pytest.approx(0.001, rel=0.15)


def test_standard_errors_are_honest(good):
    scores = [
        (each.values[key] - FAULTS[each.fault]()[key]) / each.standard_errors[key]
        for finding in good
        for each in finding.faults
        for key in each.values
    ]
    assert np.mean(np.abs(scores) < 3) > 0.95


def test_depth_without_noise_is_not_believed_to_the_micrometre(cut, tmp_path):
    with Recording(film(tmp_path / "clean.h5", cut, noise_m=0.0)) as recording:
        tool = tool_track(recording)
        for camera in CAMERAS[:2]:
            scene = camera_scene(recording, camera, tool)
            fit = fit_camera(scene)
            rows = [residuals(scene, sighting, np.zeros(TOTAL), 1.2)["table"] for sighting in scene.sightings]
            offset = np.concatenate([each.jacobian for each in rows]).mean(0)[:COUNT]  # of the mean depth
            covariance = fit.evidence.about(np.eye(TOTAL)[:, :COUNT])[1]
            assert SYSTEMATIC_M < 1.2 * np.sqrt(offset @ covariance @ offset) < 4 * SYSTEMATIC_M
            by_chance = LEAST_SIGMA["table"] / np.sqrt(fit.counts["table"])
            assert by_chance < 0.1 * SYSTEMATIC_M  # what scatter alone would tell


def test_episodes_together_are_surer_than_one_but_not_of_what_is_systematic(good, found):
    one = good[0]
    both = pool([[one], [one]]).cameras[0]
    index = {each.fault: each for each in both.faults}
    gain = [index[e.fault].standard_errors[k] / e.standard_errors[k] for e in one.faults for k in e.values]
    assert max(gain) <= 1 and min(gain) < 0.75
    mixed = pool([list(found.values()), [found["cam_00"]]]).cameras
    assert [finding.camera for finding in mixed] == CAMERAS
    assert {each.fault for each in mixed[0].found} == {"clock"}
    assert mixed[0].found[0].episodes == 2


def test_a_fault_that_half_of_the_episodes_do_not_show_is_none(good, found):
    agreed = pool([[found["cam_00"]], [found["cam_00"]]]).cameras[0]
    torn = pool([[found["cam_00"]], [good[0]]]).cameras[0]
    assert names(agreed) == ["clock"] and names(torn) == []


def names(finding):
    return [each.fault for each in finding.found]


def test_without_a_tool_scale_and_pose_are_one(faulty, tmp_path):
    path = shutil.copy(faulty, tmp_path / "cut.h5")
    with h5py.File(path, "a") as file:
        file["tool/world_from_tool"][:, 2, 3] = 50  # seen by nobody
    findings = {finding.camera: finding for finding in estimate_sensors(path)}
    scale = findings["cam_01"].found
    assert [each.fault for each in scale] == ["depth_scale"] and "pose_error" in scale[0].alternatives
    clock = findings["cam_00"].faults[0]
    assert not clock.found and clock.standard_errors["offset_s"] > 0.1


def test_two_frames_at_nearly_one_time_say_nothing_of_time(cut, tmp_path):
    path = film(tmp_path / "one.h5", resampled(cut, np.array([0.0, 1e-3])), ["depth_scale=1.01"], size=64)
    first = estimate_sensors(path)[0]
    assert [each.fault for each in first.found] == ["depth_scale"]
    by_name = {each.fault: each for each in first.faults}
    assert by_name["clock"].standard_errors["offset_s"] > 0.1


def test_the_truth_is_not_looked_at(faulty, tmp_path, found):
    path = shutil.copy(faulty, tmp_path / "cut.h5")
    with h5py.File(path, "a") as file:
        for key in ("truth", *(f"cameras/{camera}" for camera in CAMERAS[1:])):
            del file[key]
    assert estimate_sensors(path)[0].as_dict() == found["cam_00"].as_dict()
