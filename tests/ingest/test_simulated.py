"""ingest mesh and ingest disect as stages: split, resuming, equal bytes, no truth for training."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.view import MaskLabel
from plop.pipeline.stage import Input, Output
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet, split_names
from plop.recordings.truth import Truth
from plop.render.virtual_cameras.settings import CameraSettings
from stages.ingest.settings import DisectConfig
from stages.ingest.stage import INGEST_DISECT, INGEST_MESH
from tests.ingest.simulated_runs import SMALL, filmed, ingest, payload, raw_folder
from tests.support.box_sequence import box_sequence
from tests.support.without_truth import write_without_truth

KILLED_RUN = """
import sys
from pathlib import Path
from plop.pipeline.stage import Input, Output
from plop.pipeline.settings import resolve
from plop.render.virtual_cameras.settings import CameraSettings
from stages.ingest.settings import MeshConfig
from stages.ingest.stage import INGEST_MESH
raw, out = map(Path, sys.argv[1:])
INGEST_MESH.run({"raw": Input(raw)}, MeshConfig(cameras=CameraSettings(size=64, count=2)), Output(out))
"""


def test_recordings_show_the_object_where_the_truth_says(tmp_path: Path) -> None:
    summary = ingest(raw_folder(tmp_path / "raw"), tmp_path / "out", filmed(SMALL, size=48))
    recordings = RecordingSet.load(tmp_path / "out")
    assert (recordings.train, recordings.test) == (["box_000", "box_001", "box_002"], ["box_003"])
    assert recordings.environment == "box" and summary.figures["frames"] == 12 and not summary.warnings
    with recordings.open("box_003") as recording, Truth(recordings.path("box_003")) as truth:
        assert recording.camera_names == ["cam_00", "cam_01"] and len(recording) == 3
        np.testing.assert_allclose(recording.time_s, [0, 0.05, 0.1])
        for frame in range(3):
            left, right = truth.surface(frame).vertices[:8], truth.surface(frame).vertices[8:]
            for name in recording.camera_names:
                view = recording.view(name, frame)
                points = view.camera.back_project(view.depth_m, view.object_mask)
                gaps = [np.maximum(half.min(0) - points, points - half.max(0)).max(1) for half in (left, right)]
                assert np.abs(np.minimum(*gaps)).max() < 1e-5, "every object pixel lies on a half, none inside"
        assert truth.facts == {"youngs_modulus_pa": 1e4} and truth.surface_is_cut.sum() == 4


def test_same_input_gives_the_same_bytes_and_another_seed_another_texture(tmp_path: Path) -> None:
    raw = raw_folder(tmp_path / "raw", box_sequence())
    noisy = filmed(SMALL, depth_noise_m=0.002, depth_dropout=0.05)
    for folder, config in (("a", noisy), ("b", noisy), ("c", dataclasses.replace(noisy, seed=1))):
        ingest(raw, tmp_path / folder, config)
    assert payload(tmp_path / "a") == payload(tmp_path / "b") != payload(tmp_path / "c")


def test_a_fault_is_recorded_by_its_camera_alone_or_in_the_tool(tmp_path: Path) -> None:
    raw = raw_folder(tmp_path / "raw", box_sequence())
    seen = {}
    for folder, fault in (("right", ()), ("wrong", ("depth_scale=1.02@cam_01", "tool_offset.x_m=0.003"))):
        ingest(raw, tmp_path / folder, dataclasses.replace(SMALL, fault=fault))
        with Recording(tmp_path / folder / "episodes" / "box_000.h5") as recording:
            depths = [recording.view(name, 0).depth_m for name in recording.camera_names]
            seen[folder] = depths, recording.world_from_tool
    right, wrong = seen["right"], seen["wrong"]
    np.testing.assert_array_equal(right[0][0], wrong[0][0])
    np.testing.assert_allclose(wrong[0][1], 1.02 * right[0][1], rtol=1e-5)
    moved = np.linalg.inv(right[1]) @ wrong[1]
    np.testing.assert_allclose(moved[:, :3, 3], np.broadcast_to([-0.003, 0, 0], (3, 3)), atol=1e-9)
    with pytest.raises(PlopError, match="cam_09"):
        ingest(raw, tmp_path / "bad", dataclasses.replace(SMALL, fault=("clock=0.03@cam_09",)))
    assert not (tmp_path / "bad" / "episodes").exists()


def test_depth_noise_has_the_size_that_was_asked_for(tmp_path: Path) -> None:
    raw = raw_folder(tmp_path / "raw", box_sequence())
    clean_config = filmed(SMALL, size=64)
    noisy_config = filmed(clean_config, depth_noise_m=0.003, depth_dropout=0.1)
    depths = []
    for folder, config in (("clean", clean_config), ("noisy", noisy_config)):
        ingest(raw, tmp_path / folder, config)
        with Recording(tmp_path / folder / "episodes" / "box_000.h5") as recording:
            depths.append(recording.view("cam_00", 0).depth_m)
    clean, noisy = depths
    kept = noisy > 0
    assert kept[clean > 0].mean() == pytest.approx(0.9, abs=0.03)
    assert (noisy - clean)[kept].std() == pytest.approx(0.003, rel=0.1)


def test_finished_episodes_are_kept_when_a_run_goes_on(tmp_path: Path) -> None:
    raw = raw_folder(tmp_path / "raw")
    ingest(raw, tmp_path / "whole")
    out = tmp_path / "resumed"
    ingest(raw, out, dataclasses.replace(SMALL, episodes="box_000"))
    before = (out / "episodes" / "box_000.h5").stat().st_mtime_ns
    summary = ingest(raw, out)
    assert (out / "episodes" / "box_000.h5").stat().st_mtime_ns == before
    assert payload(out) == payload(tmp_path / "whole") and summary.figures["frames"] == 12


def test_a_killed_run_goes_on_to_the_same_result(tmp_path: Path) -> None:
    raw = raw_folder(tmp_path / "raw", *[box_sequence(f"box_{index:03d}", frames=8) for index in range(3)])
    config = filmed(SMALL, size=64, supersample=3)
    ingest(raw, tmp_path / "whole", config)
    out = tmp_path / "killed"
    out.mkdir()
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen([sys.executable, "-c", KILLED_RUN, str(raw), str(out)], env=env)
    deadline = time.monotonic() + 60
    while not list(out.glob("episodes/box_001.h5.*.tmp")) and process.poll() is None:
        assert time.monotonic() < deadline, "the run never reached its second episode"
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (out / "episodes.json").exists(), "a killed run does not look finished"
    ingest(raw, out, config)
    assert payload(out) == payload(tmp_path / "whole")


def test_a_test_episode_that_is_none_is_told_before_anything_is_rendered(tmp_path: Path) -> None:
    raw = raw_folder(tmp_path / "raw")
    with pytest.raises(PlopError, match="no episode of this name") as caught:
        ingest(raw, tmp_path / "out", dataclasses.replace(SMALL, test=("box_03",)))
    assert "box_003" in str(caught.value.fix) and payload(tmp_path / "out") == {}
    summary = ingest(raw, tmp_path / "out", dataclasses.replace(SMALL, test=("*_003", "ball*")))
    assert summary.warnings == ["--test ball* matches no episode"]


def test_several_environments_need_a_choice(tmp_path: Path) -> None:
    raw = raw_folder(tmp_path / "raw", box_sequence("a_0", environment="a"), box_sequence("b_0", environment="b"))
    with pytest.raises(PlopError, match="several environments") as caught:
        ingest(raw, tmp_path / "out")
    assert caught.value.found == "a, b"
    with pytest.raises(PlopError, match="no such environment"):
        ingest(raw, tmp_path / "out", dataclasses.replace(SMALL, environment="c"))
    with pytest.raises(PlopError, match="No episode"):
        ingest(raw, tmp_path / "out", dataclasses.replace(SMALL, environment="b", episodes="a*"))
    ingest(raw, tmp_path / "out", dataclasses.replace(SMALL, environment="b"))
    assert RecordingSet.load(tmp_path / "out").names == ["b_0"]
    assert INGEST_MESH.raw_files is not None
    files = INGEST_MESH.raw_files(raw, dataclasses.replace(SMALL, environment="b"))
    assert [path.name for path in files] == ["b_0.npz", "b_0.json"]


def test_split_of_disect_names() -> None:
    names = [f"prism_jelly_part_00{index}" for index in range(6)] + ["prism_jelly_000", "prism_jelly_001"]
    train, test = split_names(names, DisectConfig().test)
    assert test == ["prism_jelly_001", "prism_jelly_part_004", "prism_jelly_part_005"]
    assert train == ["prism_jelly_000", *names[:4]]
    assert split_names(["a"], ()) == (["a"], [])


def test_a_recording_without_truth_gives_everything_but_the_truth(tmp_path: Path) -> None:
    ingest(raw_folder(tmp_path / "raw", box_sequence()), tmp_path / "out")
    path = tmp_path / "out" / "episodes" / "box_000.h5"
    write_without_truth(path, tmp_path / "bare.h5")
    with h5py.File(tmp_path / "bare.h5") as file:
        assert "truth" not in file
    with pytest.raises(PlopError, match="no ground truth"):
        Truth(tmp_path / "bare.h5")
    with Recording(path) as one, Recording(tmp_path / "bare.h5") as two:
        np.testing.assert_array_equal(one.world_from_tool, two.world_from_tool)
        for field in ("rgb", "depth_m", "mask"):
            np.testing.assert_array_equal(getattr(one.view("cam_00", 1), field), getattr(two.view("cam_00", 1), field))


def test_a_real_recording_opens_its_cut(shared_data: Path, tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="usd-core (the extra `disect`) is not installed")
    cameras = CameraSettings(size=32, count=2, supersample=1)
    config = DisectConfig(environment="prism-jelly", episodes="prism_jelly_part_000", cameras=cameras)
    summary = INGEST_DISECT.run({"raw": Input(shared_data / "disect")}, config, Output(tmp_path))
    assert summary.figures["train"] == 1 and summary.table[0]["frames"] == 26
    assert summary.warnings == ["No episode is left for the test."]
    path = tmp_path / "episodes" / "prism_jelly_part_000.h5"
    with Recording(path) as recording, Truth(path) as truth:
        assert (recording.mask("cam_00", 25) == MaskLabel.OBJECT).any()
        assert recording.table_z_m == 0.0
        cut = truth.surface_is_cut
        corners = truth.surface(25).vertices[truth.surface(25).faces[cut]]
        x = corners[..., 0].mean(1)
        split = (x.min() + x.max()) / 2
        assert x[x > split].min() - x[x < split].max() > 0.02, "the halves end 29 mm apart"


def test_a_real_recording_may_begin_at_rest(shared_data: Path, tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="usd-core (the extra `disect`) is not installed")
    cameras = CameraSettings(size=32, count=2, supersample=1)
    config = DisectConfig(environment="prism-jelly", episodes="prism_jelly_part_000", cameras=cameras)
    for folder, from_rest in (("stored", False), ("rest", True)):
        (tmp_path / folder).mkdir()
        INGEST_DISECT.run(
            {"raw": Input(shared_data / "disect")},
            dataclasses.replace(config, from_rest=from_rest),
            Output(tmp_path / folder),
        )
    paths = [tmp_path / folder / "episodes" / "prism_jelly_part_000.h5" for folder in ("stored", "rest")]
    with Recording(paths[0]) as stored, Recording(paths[1]) as rest, Truth(paths[1]) as truth:
        np.testing.assert_array_equal(rest.time_s, [0, *stored.time_s])
        np.testing.assert_array_equal(rest.view("cam_00", 1).rgb, stored.view("cam_00", 0).rgb)
        np.testing.assert_allclose(truth.nodes_m(0, real_only=False), truth.rest_nodes_m, atol=1e-7)
        np.testing.assert_allclose(truth.surface(0).vertices, truth.rest_surface_vertices_m, atol=1e-7)
        fall = (truth.surface(1).vertices - truth.surface(0).vertices)[:, 2].mean()
        assert -2e-3 < fall < -2e-4, "it sags within the first 1/30 s"
