"""ingest mesh and ingest disect as stages: split, bad input, resuming, equal bytes, no truth for training."""

from __future__ import annotations

import dataclasses
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import trimesh

from plop.errors import PlopError
from plop.geometry.view import MaskLabel
from plop.pipeline.settings import resolve
from plop.pipeline.stage import Input, Output, Summary
from plop.recordings.readers.declared_units import WORLD_FROM_UP
from plop.recordings.readers.mesh.sequence import MeshSequence, write_mesh_sequence
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet, split_names
from plop.recordings.truth import Truth
from plop.render.virtual_cameras.settings import CameraSettings
from stages.ingest.resting import check_table
from stages.ingest.settings import DisectConfig, MeshConfig
from stages.ingest.stage import INGEST_DISECT, INGEST_MESH
from stages.ingest.surface_checks import check_order, sound_surface
from tests.support.box_sequence import box_sequence
from tests.support.without_truth import write_without_truth

BOX = box_sequence()
SMALL = MeshConfig(cameras=CameraSettings(size=24, count=2, supersample=1))

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


def filmed(config: MeshConfig, **cameras: object) -> MeshConfig:
    return dataclasses.replace(config, cameras=dataclasses.replace(config.cameras, **cameras))


def ingest(raw: Path, folder: Path, config: MeshConfig = SMALL) -> Summary:
    folder.mkdir(exist_ok=True)
    return INGEST_MESH.run({"raw": Input(raw)}, config, Output(folder))


def raw_folder(folder: Path, *sequences: MeshSequence) -> Path:
    for sequence in sequences or [box_sequence(f"box_{index:03d}") for index in range(4)]:
        write_mesh_sequence(folder, sequence)
    return folder


def payload(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and ".done" not in path.parts and path.suffix != ".tmp"
    }


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


@pytest.mark.parametrize(
    ("content", "problem", "found"),
    [("{", "missing or damaged", "JSONDecodeError"), ('{"environment": "box", "schema": 99}', "newer", "schema 99")],
)
def test_an_episode_with_an_unreadable_side_file_is_told_not_dropped(
    tmp_path: Path, content: str, problem: str, found: str
) -> None:
    raw = raw_folder(tmp_path / "raw", *[box_sequence(f"cut-{index}") for index in range(3)])
    (raw / "cut-0.json").write_text(content)
    for environment in ("", "box"):  # its name tells neither
        with pytest.raises(PlopError, match=problem) as caught:
            ingest(raw, tmp_path / "out", dataclasses.replace(SMALL, environment=environment))
        assert str(caught.value.where) == str(raw / "cut-0.json") and found in str(caught.value.found)
    summary = ingest(raw, tmp_path / "out", dataclasses.replace(SMALL, skip_bad=True))
    assert RecordingSet.load(tmp_path / "out").environment == "box"
    assert any("cut-0 was left out" in text and problem in text for text in summary.warnings)


def _scaled(factor: float) -> MeshSequence:
    box = box_sequence()
    return dataclasses.replace(box, vertices=box.vertices * factor, rest_vertices=box.rest * factor)


@pytest.mark.parametrize(
    ("sequence", "message"),
    [
        (_scaled(1000), "implausible size"),
        (_scaled(1e-3), "implausible size"),
        (dataclasses.replace(BOX, tool_vertices=BOX.tool_vertices * 1000), "tool has an implausible"),
        (dataclasses.replace(BOX, vertices=BOX.vertices + [3.0, 0, 0]), "outside the workspace"),
        (dataclasses.replace(BOX, table_z_m=0.06), "far below its table"),
    ],
)
def test_implausible_episodes_are_refused_and_leave_nothing(
    tmp_path: Path, sequence: MeshSequence, message: str
) -> None:
    with pytest.raises(PlopError, match=message) as caught:
        ingest(raw_folder(tmp_path / "raw", sequence), tmp_path / "out")
    assert "box_000" in str(caught.value.where)
    assert payload(tmp_path / "out") == {}


def in_millimetres(poses: np.ndarray) -> np.ndarray:
    return poses * np.where(np.eye(4)[3] * [[1], [1], [1], [0]], 1000, 1)


@pytest.mark.parametrize(
    ("sequence", "key", "found"),
    [
        (dataclasses.replace(BOX, times=BOX.times * 1000), "box_000.npz: times", "milliseconds"),
        (
            dataclasses.replace(
                BOX, times=BOX.times[:1], vertices=BOX.vertices[:1], truth={}, world_from_tool=BOX.world_from_tool[:1]
            ),
            "box_000.npz: times",
            "1 frame",
        ),
        (
            dataclasses.replace(BOX, world_from_tool=in_millimetres(BOX.world_from_tool)),
            "box_000.npz: world_from_tool",
            "m away",
        ),
        (dataclasses.replace(BOX, table_z_m=1.0), "box_000.json: table_z_m", "z = 0 to 0.03 m"),
    ],
)
def test_what_cannot_be_an_episode_is_refused_by_file_and_key(
    tmp_path: Path, sequence: MeshSequence, key: str, found: str
) -> None:
    with pytest.raises(PlopError) as caught:
        ingest(raw_folder(tmp_path / "raw", sequence), tmp_path / "out")
    assert str(caught.value.where).endswith(key)
    assert re.search(found, str(caught.value.found))
    assert payload(tmp_path / "out") == {}


def test_tool_poses_that_are_none_are_refused_by_file_and_key(tmp_path: Path) -> None:
    raw = raw_folder(tmp_path / "raw")
    for factor in (np.nan, 2, 0, [-1, 1, 1]):
        with np.load(raw / "box_001.npz") as file:
            arrays = dict(file)
        arrays["world_from_tool"] = BOX.world_from_tool.copy()
        arrays["world_from_tool"][:, :3, :3] *= factor
        np.savez(raw / "box_001.npz", **arrays)
        with pytest.raises(PlopError) as caught:
            ingest(raw, tmp_path / "out")
        assert caught.value.where == f"{raw / 'box_001.npz'}: world_from_tool"


def test_a_bad_episode_can_be_left_out_with_its_reason(tmp_path: Path) -> None:
    raw = raw_folder(tmp_path / "raw")
    (raw / "box_001.npz").write_bytes(b"")
    with pytest.raises(PlopError, match="damaged"):
        ingest(raw, tmp_path / "out")
    summary = ingest(raw, tmp_path / "out", dataclasses.replace(SMALL, skip_bad=True))
    recordings = RecordingSet.load(tmp_path / "out")
    assert list(recordings.skipped) == ["box_001"] and "box_001" not in recordings.names
    assert any("box_001 was left out" in warning for warning in summary.warnings)


def test_a_tool_that_never_touches_is_refused(tmp_path: Path) -> None:
    box = box_sequence()
    away = box.world_from_tool.copy()
    away[:, 0, 3] += 0.2
    raw = raw_folder(tmp_path / "raw", dataclasses.replace(box, world_from_tool=away))
    with pytest.raises(PlopError, match="never touches") as caught:
        ingest(raw, tmp_path / "out")
    assert caught.value.where == f"{raw / 'box_000.npz'}: world_from_tool" and "mm at its closest" in caught.value.found
    assert "--keep-untouched" in caught.value.fix and not list((tmp_path / "out").rglob("*.h5"))
    with pytest.raises(PlopError, match="No episode is usable"):
        ingest(raw, tmp_path / "skipped", dataclasses.replace(SMALL, skip_bad=True))
    ingest(raw, tmp_path / "kept", dataclasses.replace(SMALL, keep_untouched=True))
    assert RecordingSet.load(tmp_path / "kept").names


def test_a_camera_that_loses_the_object_is_pointed_out(tmp_path: Path) -> None:
    box = box_sequence()
    vertices = box.vertices + np.array([0, 0.4, 0.8])[:, None, None] * [1.0, 1.0, 0]
    raw = raw_folder(tmp_path / "raw", dataclasses.replace(box, vertices=vertices))
    summary = ingest(raw, tmp_path / "out", dataclasses.replace(SMALL, keep_untouched=True))
    assert any("leaves the view" in warning for warning in summary.warnings)


@pytest.mark.parametrize(
    "change",
    [
        {"cameras.size": 2},
        {"cameras.count": 0},
        {"cameras.supersample": 2},
        {"cameras.depth_dropout": 1.0},
        {"cameras.depth_noise_m": np.nan},
        {"cameras.room_m": np.inf},
        {"workspace_m": np.nan},
        {"smallest_m": 3.0},
    ],
)
def test_settings_out_of_range_are_named(change: dict[str, float]) -> None:
    with pytest.raises(PlopError, match=f"{next(iter(change))}") as caught:
        resolve(MeshConfig, "ingest mesh", ("--set", change))
    assert re.fullmatch(
        r"[0-9.]+ to [0-9.]+( px| m)?|an odd number|largest_m of 3 m or more", str(caught.value.expected)
    )


def test_blender_that_is_not_there_is_a_clear_error(tmp_path: Path) -> None:
    config = filmed(SMALL, renderer="blender", blender="no-such-blender")
    with pytest.raises(PlopError, match="Blender is not found"):
        ingest(raw_folder(tmp_path / "raw"), tmp_path / "out", config)
    assert payload(tmp_path / "out") == {}


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


def _soft_block() -> MeshSequence:
    """A fine block that is pressed and falls in two parts, one of which is thrown aside from one frame to the next."""
    ball = trimesh.creation.icosphere(2, radius=0.03)
    rest = np.asarray(ball.vertices) + [0, 0, 0.03]
    vertices = np.stack(
        [np.concatenate([rest * [1 + 0.1 * k, 1, 1 - 0.1 * k], rest + [0.08 + 0.05 * (k > 2), 0, 0]]) for k in range(6)]
    )
    faces = np.concatenate([ball.faces, ball.faces + len(rest)])
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 2, 3] = np.linspace(0.08, 0.06, 6)
    return dataclasses.replace(
        BOX,
        times=np.arange(6) / 30,
        vertices=vertices,
        faces=faces,
        world_from_tool=poses,
        rest_vertices=vertices[0],
        cut_faces=None,
        truth={},
    )


def test_vertices_that_change_their_order_are_told_from_fast_motion() -> None:
    block, rng = _soft_block(), np.random.default_rng(0)
    assert check_order(block, Path("e.npz")) == []
    turns = np.arange(6) * np.pi / 2
    spun = np.stack(
        [
            frame @ [[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]
            for frame, a in zip(block.vertices, turns, strict=True)
        ]
    )
    assert check_order(dataclasses.replace(block, vertices=spun), Path("e.npz")) == []
    count = block.vertices.shape[1]
    for change, frame in ((rng.permutation(count), 4), (np.roll(np.arange(count), 1), 2)):
        vertices = block.vertices.copy()
        vertices[frame:] = vertices[frame:][:, change]
        with pytest.raises(PlopError, match="order of the vertices changes") as caught:
            check_order(dataclasses.replace(block, vertices=vertices), Path("e.npz"))
        assert str(caught.value.where).endswith(f"frame {frame}")
    swapped = block.vertices.copy()
    swapped[1:, [3, 90]] = swapped[1:, [90, 3]]
    with pytest.raises(PlopError, match="order of the vertices changes"):
        check_order(dataclasses.replace(block, vertices=swapped), Path("e.npz"))
    with pytest.raises(PlopError, match="not in the same order"):
        check_order(dataclasses.replace(block, rest_vertices=block.rest[rng.permutation(count)]), Path("e.npz"))


@pytest.mark.parametrize("up", ["x", "y", "-y", "-z"])
@pytest.mark.parametrize("place", [(0, 0), (0.11, -0.07)])
def test_each_wrong_up_axis_is_told_with_the_right_one(up: str, place: tuple[float, float]) -> None:
    turn = WORLD_FROM_UP[up].T
    turned = dataclasses.replace(BOX, vertices=(BOX.vertices + [*place, 0]) @ turn.T, rest_vertices=None)
    with pytest.raises(PlopError, match="up axis seems to be wrong") as caught:
        check_table(turned, Path("e.json"))
    assert f'"up": "{up}"' in str(caught.value.fix)


def test_a_hollow_keeps_its_inner_side_when_its_body_is_turned() -> None:
    outer, inner = trimesh.creation.box([0.06, 0.06, 0.06]), trimesh.creation.box([0.02, 0.02, 0.02])
    corners = np.concatenate([outer.vertices, inner.vertices]) + [0, 0, 0.03]
    faces = np.concatenate([outer.faces, np.asarray(inner.faces)[:, ::-1] + len(outer.vertices)])
    vertices = np.tile(corners, (3, 1, 1))
    hollow = dataclasses.replace(BOX, vertices=vertices, faces=faces, rest_vertices=None, cut_faces=None, truth={})
    assert sound_surface(hollow, Path("e.npz")) == (hollow, [])
    mended, notes = sound_surface(dataclasses.replace(hollow, faces=faces[:, ::-1]), Path("e.npz"))
    np.testing.assert_array_equal(mended.faces, faces)
    assert len(notes) == 1 and "were flipped" in notes[0]
