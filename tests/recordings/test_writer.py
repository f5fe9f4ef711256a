"""A recording survives the round trip, byte for byte, and a failed one leaves nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from plop.errors import PlopError
from plop.recordings.recording import Mesh, Recording
from plop.recordings.writer import RecordingWriter

TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]]))
FRAMES, SIZE = 3, (4, 5)


def images(frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(frame)
    rgb = random.integers(0, 256, (*SIZE, 3), dtype=np.uint8)
    return rgb, random.random(SIZE, dtype=np.float32) + 0.1, random.integers(0, 3, SIZE, dtype=np.uint8)


def write(path: Path, frames: int = FRAMES) -> None:
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    with RecordingWriter(
        path,
        name="one",
        source="test",
        environment="box",
        table_z_m=None,
        time_s=np.arange(FRAMES) / 10,
        tool_mesh=TRIANGLE,
        world_from_tool=poses,
    ) as writer:
        writer.add_camera("a", np.eye(3), poses, *SIZE)
        writer.add_camera("wrist", np.eye(3), poses[:1], *SIZE, group="scan")
        for frame in range(frames):
            writer.write_frame("a", frame, *images(frame))
        writer.write_frame("wrist", 0, *images(9), group="scan")
        writer.add_truth("surface_vertices_m", np.zeros((FRAMES, 7, 3), np.float32))


def test_reads_back_what_was_written(tmp_path: Path) -> None:
    write(tmp_path / "one.h5")
    with Recording(tmp_path / "one.h5") as recording:
        assert (recording.name, recording.environment, recording.table_z_m) == ("one", "box", None)
        assert len(recording) == FRAMES and recording.scan_length("wrist") == 1
        view = recording.view("a", 1)
        for found, expected in zip((view.rgb, view.depth_m, view.mask), images(1), strict=True):
            np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(recording.view("wrist", 0, group="scan").rgb, images(9)[0])
        np.testing.assert_array_equal(recording.tool_mesh.vertices, TRIANGLE.vertices)


def test_same_calls_give_the_same_bytes(tmp_path: Path) -> None:
    write(tmp_path / "one.h5")
    write(tmp_path / "two.h5")
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()


def test_one_frame_is_one_chunk(tmp_path: Path) -> None:
    import h5py

    write(tmp_path / "one.h5")
    with h5py.File(tmp_path / "one.h5") as file:
        assert file["cameras/a/rgb"].chunks == (1, *SIZE, 3)
        assert file["cameras/a/depth_m"].compression == "gzip"


def test_missing_frames_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    with pytest.raises(PlopError, match="Frames are missing"):
        write(tmp_path / "one.h5", frames=FRAMES - 1)
    assert list(tmp_path.iterdir()) == []


def test_a_failure_keeps_the_older_recording(tmp_path: Path) -> None:
    write(tmp_path / "one.h5")
    before = (tmp_path / "one.h5").read_bytes()
    with pytest.raises(PlopError):
        write(tmp_path / "one.h5", frames=1)
    assert (tmp_path / "one.h5").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["one.h5"]


def test_nan_and_infinite_depth_become_not_measured(tmp_path: Path) -> None:
    poses = np.tile(np.eye(4), (2, 1, 1))
    with RecordingWriter(
        tmp_path / "n.h5",
        name="n",
        source="test",
        environment="box",
        table_z_m=0.0,
        time_s=np.arange(2),
        tool_mesh=TRIANGLE,
        world_from_tool=poses,
    ) as writer:
        writer.add_camera("a", np.eye(3), poses, *SIZE)
        rgb, depth, mask = images(0)
        depth[0, :3] = np.nan, np.inf, -1
        for frame in range(2):
            writer.write_frame("a", frame, rgb, depth, mask)
    with Recording(tmp_path / "n.h5") as recording:
        assert (recording.view("a", 0).depth_m[0, :3] == 0).all()
        assert (recording.view("a", 0).depth_m[1:] > 0).all()


@pytest.mark.parametrize("time", [[0.0, 0.0], [0.0, np.nan], [0.0], []])
def test_bad_times_are_refused(tmp_path: Path, time: list[float]) -> None:
    poses = np.tile(np.eye(4), (len(time), 1, 1))
    with pytest.raises(PlopError, match="Time"):
        RecordingWriter(
            tmp_path / "n.h5",
            name="n",
            source="test",
            environment="box",
            table_z_m=0.0,
            time_s=np.array(time),
            tool_mesh=TRIANGLE,
            world_from_tool=poses,
        )


def test_the_reader_of_recordings_does_not_give_the_truth(tmp_path: Path) -> None:
    write(tmp_path / "one.h5")
    with Recording(tmp_path / "one.h5") as recording:
        for group in ("truth", "/truth", "../truth"):
            with pytest.raises((PlopError, KeyError)):
                recording.view("surface_vertices_m", 0, group=group)
