"""One simulated cut, filmed small, with and without sensor faults."""

from __future__ import annotations

from dataclasses import replace

import pytest

from plop.physics.scenes.demo import CutPlan, demo_episode
from plop.recordings.readers.mesh.resample import resampled
from plop.render.virtual_cameras.recorder import Disturbances, record
from plop.render.virtual_cameras.settings import CameraSettings
from plop.sensors.faults.library import parse_faults

CAMERAS = [f"cam_{index:02d}" for index in range(6)]
FAULTY = [
    "clock=0.02@cam_00",
    "depth_scale=1.01@cam_01",
    "depth_bias=0.003@cam_02",
    "pose_drift.x_m=0.003@cam_03",
    "pose_drift.ry_rad=0.01746@cam_02",
    "pose_drift.ry_rad=0.00873@cam_04",
    "pose_error.z_m=0.003@cam_05",
    "clock=-0.02@cam_05",
]


@pytest.fixture(scope="session")
def cut():
    return demo_episode("cut", CutPlan(0.0, 0.1, 0.1, 0.02, 0.07))


def film(path, sequence, faults=(), size=96, noise_m=0.001):
    settings = CameraSettings(size=size, supersample=1, depth_noise_m=noise_m)
    for _ in record(path, sequence, settings, Disturbances(parse_faults(list(faults), CAMERAS))):
        pass
    return path


@pytest.fixture(scope="session")
def faulty(cut, tmp_path_factory):
    return film(tmp_path_factory.mktemp("faulty") / "cut.h5", cut, FAULTY)


@pytest.fixture(scope="session")
def lagging_object(cut, tmp_path_factory):
    """Good cameras; the object follows the tool 40 ms too late."""
    late = replace(cut, vertices=resampled(cut, cut.times - 0.04).vertices)
    return film(tmp_path_factory.mktemp("good") / "cut.h5", late)
