"""A recording that is not what it should be is refused with the file, the finding and the fix."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from plop.errors import PlopError
from plop.recordings.recording import MaskLabel, Recording
from plop.recordings.set import RecordingSet
from tests.recordings.test_writer import write


def test_missing_and_truncated_files(tmp_path: Path) -> None:
    path = tmp_path / "one.h5"
    with pytest.raises(PlopError, match="no such recording"):
        Recording(path)
    write(path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(PlopError, match="cannot be opened"):
        Recording(path)


def test_another_schema(tmp_path: Path) -> None:
    write(tmp_path / "one.h5")
    for schema, fix in ((99, "Update plop."), (0, "Run `plop ingest` for this episode again.")):
        with h5py.File(tmp_path / "one.h5", "a") as file:
            file.attrs["schema"] = schema
        with pytest.raises(PlopError, match="another schema") as caught:
            Recording(tmp_path / "one.h5")
        assert caught.value.fix == fix


def test_missing_keys_and_lengths_that_do_not_match(tmp_path: Path) -> None:
    write(tmp_path / "one.h5")
    with h5py.File(tmp_path / "one.h5", "a") as file:
        del file["tool/world_from_tool"]
        file["tool/world_from_tool"] = np.tile(np.eye(4), (2, 1, 1))
    with pytest.raises(PlopError, match="lengths do not match"):
        Recording(tmp_path / "one.h5")
    with h5py.File(tmp_path / "one.h5", "a") as file:
        del file["frames"]
    with pytest.raises(PlopError, match="incomplete"):
        Recording(tmp_path / "one.h5")


@pytest.mark.parametrize("part", ["depth_m", "mask"])
def test_a_picture_of_another_size_is_named_with_both_sizes(tmp_path: Path, part: str) -> None:
    write(tmp_path / "one.h5")
    with h5py.File(tmp_path / "one.h5", "a") as file:
        frames, height, width = file["cameras/a/rgb"].shape[:3]
        del file[f"cameras/a/{part}"]
        file[f"cameras/a/{part}"] = np.zeros((frames, height, width // 2), np.uint8)
    with pytest.raises(PlopError, match="another size") as caught:
        Recording(tmp_path / "one.h5")
    assert str(caught.value.where).endswith(f"one.h5:/cameras/a/{part}")
    assert f"{height} x {width}," in str(caught.value.expected) and f"{height} x {width // 2}" in str(
        caught.value.found
    )


@pytest.mark.parametrize("faces", [np.zeros((0, 3), int), np.array([[0, 1, 999]])])
def test_a_tool_without_a_mesh_is_named(tmp_path: Path, faces: np.ndarray) -> None:
    write(tmp_path / "one.h5")
    with h5py.File(tmp_path / "one.h5", "a") as file:
        del file["tool/mesh/faces"]
        file["tool/mesh/faces"] = faces
    with Recording(tmp_path / "one.h5") as recording, pytest.raises(PlopError, match="tool's mesh") as caught:
        _ = recording.tool_mesh
    assert str(caught.value.where).endswith("one.h5:/tool/mesh")


def test_an_unknown_camera_is_told_with_the_known_ones(tmp_path: Path) -> None:
    write(tmp_path / "one.h5")
    with Recording(tmp_path / "one.h5") as recording, pytest.raises(PlopError, match="no such camera") as caught:
        recording.view("b", 0)
    assert caught.value.expected == "a"


def test_masks_of_a_view(tmp_path: Path) -> None:
    write(tmp_path / "one.h5")
    with Recording(tmp_path / "one.h5") as recording:
        view = recording.view("a", 0)
        np.testing.assert_array_equal(view.object_mask, view.mask == MaskLabel.OBJECT)
        np.testing.assert_array_equal(recording.mask("a", 0), view.mask)


def test_a_set_survives_the_round_trip_and_a_damaged_one_is_refused(tmp_path: Path) -> None:
    RecordingSet(tmp_path, "box", ["a", "b"], ["c"], {"d": "no frames"}).save()
    found = RecordingSet.load(tmp_path)
    assert found.names == ["a", "b", "c"] and found.skipped == {"d": "no frames"}
    (tmp_path / "episodes.json").write_text("{")
    with pytest.raises(PlopError, match="not a set of recordings"):
        RecordingSet.load(tmp_path)
