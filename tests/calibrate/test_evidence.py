"""Each camera alone: a fault of one is named and harms no other, and "good" needs more than agreement."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from plop.errors import PlopError
from plop.pipeline.stage import Input, Output
from plop.recordings.camera_verdicts import bad_cameras
from plop.recordings.set import RecordingSet
from stages.calibrate.stage import CalibrateConfig
from stages.fuse.stage import STAGE as FUSE
from stages.fuse.stage import FuseConfig
from tests.calibrate.test_calibrate_stage import calibrate
from tests.support.ellipsoid_scene import ring, write_set


def change(folder, what):
    with h5py.File(folder / "episodes" / "a.h5", "r+") as file:
        for name in file["cameras"]:
            what(file, name)


def as_distance(camera):
    """Turn a camera's depth into distance along the ray."""

    def what(file, name):
        if name == camera.name:
            depth = file[f"cameras/{name}/depth_m"]
            depth[...] = depth[:] * np.linalg.norm(camera.pixel_directions(), axis=-1)

    return what


def wide(count):
    """Cameras near enough for a table to bend."""
    return ring(count, distance=0.2, height=0.2)


def test_distance_of_one_camera_is_named_and_the_others_stay(tmp_path):
    cameras = [
        type(c)(
            c.name,
            c.width,
            c.height,
            c.intrinsics * [[0.5], [0.5], [1]] + np.array([[0, 0, c.width / 4], [0, 0, c.height / 4], [0, 0, 0]]),
            c.world_from_cam,
        )
        for c in wide(3)
    ]
    write_set(tmp_path / "set", {"a": {}}, cameras=cameras)
    change(tmp_path / "set", as_distance(cameras[1]))
    _, facts = calibrate(tmp_path / "set", tmp_path / "out")
    entry = facts["cameras"]["cam1"]
    assert entry["verdict"] == "bad" and "distance along the ray" in entry["fix"] and not entry["usable"]
    for name in ("cam0", "cam2"):
        assert facts["cameras"][name]["verdict"] == "good" and facts["cameras"][name]["depth_scale"] == 1
    assert list(bad_cameras(tmp_path / "out", "a")) == ["cam1"]
    (tmp_path / "fused").mkdir()
    summary = FUSE.run({"recordings": Input(tmp_path / "out")}, FuseConfig(), Output(tmp_path / "fused"))
    assert summary.table[0]["views"] == 2 and any("cam1 is left out" in each for each in summary.warnings)


def test_agreement_alone_is_not_good(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(4), table_z_m=None)

    def grey(file, name):
        file[f"cameras/{name}/rgb"][...] = 128

    change(tmp_path / "set", grey)
    _, facts = calibrate(tmp_path / "set", tmp_path / "out")
    assert {entry["verdict"] for entry in facts["cameras"].values()} <= {"agreed", "good"}
    for entry in facts["cameras"].values():
        assert (entry["verdict"] == "agreed") == (entry["checks"] in ("", "flat"))
        assert "edges" not in entry["checks"] and "table" not in entry["checks"] and entry["table_mm"] is None


def test_a_table_that_all_see_elsewhere_is_told_of_table_z(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(3), table_z_m=-0.015)
    with pytest.raises(PlopError) as refused:
        calibrate(tmp_path / "set", tmp_path / "out")
    assert "all cameras see the table +15.0 mm from table_z" in refused.value.render()
    _, facts = calibrate(tmp_path / "set", tmp_path / "kept", CalibrateConfig(keep_bad=True))
    assert RecordingSet.load(tmp_path / "kept").names == ["a"]
    assert {entry["verdict"] for entry in facts["cameras"].values()} == {"bad"}


@pytest.mark.parametrize("off_mm", [-4.0, 4.0])
def test_a_table_that_is_off_by_what_hands_measure_is_good(tmp_path, off_mm):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(3), table_z_m=off_mm / 1e3)
    _, facts = calibrate(tmp_path / "set", tmp_path / "out")
    assert {entry["verdict"] for entry in facts["cameras"].values()} == {"good"}
    assert all(entry["table_mm"] == pytest.approx(-off_mm, abs=0.5) for entry in facts["cameras"].values())
