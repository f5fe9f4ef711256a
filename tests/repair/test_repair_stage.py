"""repair: what a fault changed comes back, the rest is refused; a diagnosis prints what repair takes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from plop.artifacts.manifest import Manifest
from plop.diagnosis.decision.next_step import next_step
from plop.diagnosis.decision.result import SensorFault
from plop.errors import PlopError
from plop.parameters import Estimate
from plop.pipeline.stage import Input, Output
from plop.recordings.set import RecordingSet
from plop.render.virtual_cameras.recorder import Disturbances, record
from plop.render.virtual_cameras.settings import CameraSettings
from plop.sensors.faults.library import ALL_FAULTS, parse_faults
from stages.repair.stage import STAGE, RepairConfig
from tests.support.box_sequence import box_sequence
from tests.support.diagnoses import verdict

CAMERAS = ["cam_00", "cam_01"]
TYPED = {
    "pose_error": ("pose_error.x_m=0.004@cam_01", "pose_error.ry_rad=0.01@cam_01"),
    "pose_drift": ("pose_drift.z_m=0.005",),
    "depth_scale": ("depth_scale=1.02", "depth_bias=-0.004"),
    "depth_bias": ("depth_bias=0.003@*",),
    "robot_clock": ("robot_clock=0.02",),
    "tool_offset": ("tool_offset.x_m=0.003", "tool_offset.z_m=-0.002"),
    "tool_thickness": ("tool_thickness=0.002",),
}


def film(folder: Path, faults=()) -> Path:
    sequence = box_sequence()
    path = folder / "episodes" / f"{sequence.name}.h5"
    path.parent.mkdir(parents=True)
    disturbances = Disturbances(parse_faults(faults, CAMERAS))
    for _ in record(path, sequence, CameraSettings(size=24, count=2, supersample=1), disturbances):
        pass
    RecordingSet(folder, sequence.environment, [sequence.name], []).save()
    return folder


def repair(folder: Path, out: Path, *faults: str, manifest: Manifest | None = None):
    out.mkdir(exist_ok=True)
    return STAGE.run({"recordings": Input(folder, manifest)}, RepairConfig(faults, 1), Output(out))


@pytest.mark.parametrize("fault", TYPED)
def test_what_a_fault_changed_comes_back(tmp_path, fault):
    """Cameras are filmed from elsewhere than recorded, so that poses come back as those that were filmed from."""
    right, wrong = film(tmp_path / "right"), film(tmp_path / "wrong", TYPED[fault])
    repair(wrong, tmp_path / "repaired", *TYPED[fault])
    true, back = (RecordingSet.load(folder).open("box_000") for folder in (right, tmp_path / "repaired"))
    before = RecordingSet.load(wrong).open("box_000")
    faults = parse_faults(TYPED[fault], CAMERAS)
    with true, back, before:
        for name in CAMERAS:
            for k, share in enumerate((0, 0.5, 1)):
                pose = faults.true_pose(name, share, true.camera(name, k).world_from_cam)
                np.testing.assert_allclose(back.camera(name, k).world_from_cam, pose, atol=1e-12)
            if "pose" not in fault:
                np.testing.assert_allclose(back.view(name, 1).depth_m, true.view(name, 1).depth_m, atol=1e-6)
        middle = len(true) // 2  # at the ends a clock lacks what was before, or will be
        np.testing.assert_allclose(back.world_from_tool[middle], true.world_from_tool[middle], atol=1e-9)
        np.testing.assert_allclose(back.tool_mesh.vertices, true.tool_mesh.vertices, atol=1e-9)
        changed = [
            (before.world_from_tool[middle] != true.world_from_tool[middle]).any(),
            (before.tool_mesh.vertices != true.tool_mesh.vertices).any(),
            (before.view("cam_00", 1).depth_m != true.view("cam_00", 1).depth_m).any(),
            (before.view("cam_01", 1).depth_m != true.view("cam_01", 1).depth_m).any(),
        ]
        assert any(changed), "the fault does something"


def test_what_is_not_faulty_stays(tmp_path):
    folder = film(tmp_path / "set")
    (folder / "calibration.json").write_text('{"episodes": {}}')
    before = (folder / "episodes" / "box_000.h5").read_bytes()
    repair(folder, tmp_path / "out", "pose_error.x_m=0.004@cam_01")
    assert (folder / "episodes" / "box_000.h5").read_bytes() == before
    assert (tmp_path / "out" / "calibration.json").read_text() == '{"episodes": {}}', "cameras stay judged"
    with RecordingSet.load(folder).open("box_000") as old, RecordingSet.load(tmp_path / "out").open("box_000") as new:
        np.testing.assert_array_equal(new.camera("cam_00", 1).world_from_cam, old.camera("cam_00", 1).world_from_cam)
        np.testing.assert_array_equal(new.view("cam_01", 1).depth_m, old.view("cam_01", 1).depth_m)
        np.testing.assert_array_equal(new.world_from_tool, old.world_from_tool)


@pytest.mark.parametrize(
    ("faults", "message"),
    [
        ((), "No fault is named"),
        (("clock=0.03@cam_01",), "clock of a single camera.*--exclude cam_01"),
        (("tool_offset.x_m=0.003@cam_01",), "has no camera"),
        (("pose_error.x_m=0.003@cam_07",), "camera that does not exist"),
        (("tool_ofset=0.003",), "no such sensor fault"),
        (("tool_thickness=0.5",), "out of range"),
    ],
)
def test_what_cannot_be_put_right_is_refused(tmp_path, faults, message):
    folder = film(tmp_path / "set")
    with pytest.raises(PlopError) as caught:
        repair(folder, tmp_path / "out", *faults)
    assert re.search(message, str(caught.value), re.DOTALL)
    assert not list((tmp_path / "out").iterdir())


def test_a_fault_is_put_right_once(tmp_path):
    made = Manifest("repair", "a" * 16, 1, {"fault": ["robot_clock=0.03"]}, {})
    with pytest.raises(PlopError, match="before"):
        repair(film(tmp_path / "set"), tmp_path / "out", "robot_clock=0.03", manifest=made)


def found(camera: str, name: str) -> SensorFault:
    values = {p.name: Estimate(p.default + (k + 1) * p.step / 3) for k, p in enumerate(ALL_FAULTS[name].parameters)}
    return SensorFault(camera, name, f"{name} of {camera}", 9.0, values, ())


def said(*sensors: SensorFault) -> str:
    class Found:
        verdict = verdict("SENSOR", *(fault.text for fault in sensors))

    return next_step(Found(), sensors)


def test_a_diagnosis_prints_what_repair_takes():
    sensors = [found("cam_01", "pose_error"), found("cam_00", "depth_scale"), found("tool", "tool_offset")]
    [typed] = re.findall(r"--fault (\S+)`", said(*sensors))
    faults = parse_faults(typed.split(","), CAMERAS)
    assert {fault.name for fault in faults.tool} == {"tool_offset"}
    assert {name: [f.name for f in own] for name, own in faults.by_camera.items()} == {
        "cam_00": ["depth_scale"],
        "cam_01": ["pose_error"],
    }
    for sensor in sensors:
        places = faults.tool if sensor.camera == "tool" else faults.of(sensor.camera)
        assert places[0].values == pytest.approx({key: p.value for key, p in sensor.values.items()}, rel=1e-3)


def test_a_camera_with_a_late_clock_is_left_out():
    alone, beside = said(found("cam_00", "clock")), said(found("cam_00", "clock"), found("cam_01", "depth_bias"))
    assert "--exclude cam_00" in alone and "repair" not in alone
    assert "--exclude cam_00" in beside and "--fault depth_bias.offset_m=0.0003333@cam_01`" in beside
