"""A recording that is not what it should be is refused with the file, the finding and the fix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.view import MaskLabel
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet, check_patterns
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


def put(key: str, value: object) -> Callable[[h5py.File], None]:
    """Give a change that puts another array, or nothing, under a key."""

    def change(file: h5py.File) -> None:
        del file[key]
        if value is not None:
            file[key] = value

    return change


POSES = np.tile(np.eye(4), (3, 1, 1))


@pytest.mark.parametrize(
    ("change", "key", "message"),
    [
        *[
            (put(key, None), key, "incomplete")
            for key in (
                "cameras/a/rgb",
                "cameras/a/depth_m",
                "cameras/a/intrinsics",
                "cameras/a/world_from_cam",
                "scan/wrist/mask",
                "tool/mesh/vertices",
            )
        ],
        (put("cameras", None), "cameras", "no camera"),
        (put("frames/time_s", np.ones((3, 1))), "frames/time_s", "unexpected shape"),
        (put("frames/time_s", 1.0), "frames/time_s", "unexpected shape"),
        (put("tool/world_from_tool", np.full((3, 4, 4), b"x")), "tool/world_from_tool", "unexpected shape or type"),
        (lambda file: file.attrs.pop("environment"), "", "incomplete"),
        (put("cameras/a", None), "cameras", "no camera"),
        (put("cameras/a/rgb", np.zeros((3, 4, 5), np.uint8)), "cameras/a/rgb", "unexpected shape"),
        (put("cameras/a/intrinsics", np.zeros((3, 3))), "cameras/a/intrinsics", "focal length"),
        (put("cameras/a/intrinsics", np.full((3, 3), np.nan)), "cameras/a/intrinsics", "not finite"),
        (put("cameras/a/intrinsics", np.ones(4)), "cameras/a/intrinsics", "unexpected shape"),
        (put("cameras/a/world_from_cam", POSES * np.nan), "cameras/a/world_from_cam", "not finite"),
        (put("cameras/a/world_from_cam", POSES[:2]), "cameras/a/world_from_cam", "lengths"),
        (put("scan/wrist/world_from_cam", POSES[:1] * 2), "scan/wrist/world_from_cam", "not a rotation"),
        (put("tool/world_from_tool", POSES * np.nan), "tool/world_from_tool", "not finite"),
        (put("tool/world_from_tool", POSES[:, 0]), "tool/world_from_tool", "unexpected shape"),
        (put("frames/time_s", np.ones(3)), "frames/time_s", "does not increase"),
        (put("frames/time_s", np.array([0, 1, np.nan])), "frames/time_s", "does not increase"),
    ],
)
def test_a_recording_that_no_stage_can_use_is_refused_by_key(
    tmp_path: Path, change: Callable[[h5py.File], None], key: str, message: str
) -> None:
    write(tmp_path / "one.h5")
    with h5py.File(tmp_path / "one.h5", "a") as file:
        change(file)
    with pytest.raises(PlopError, match=message) as caught:
        Recording(tmp_path / "one.h5")
    assert str(caught.value.where) == f"{tmp_path / 'one.h5'}:/{key}" and caught.value.expected and caught.value.found
    assert caught.value.fix


def test_a_single_frame_is_no_recording(tmp_path: Path) -> None:
    write(tmp_path / "one.h5")
    with h5py.File(tmp_path / "one.h5", "a") as file:
        for key in (
            "frames/time_s",
            "tool/world_from_tool",
            *(f"cameras/a/{part}" for part in ("rgb", "depth_m", "mask", "world_from_cam")),
        ):
            put(key, file[key][:1])(file)
    with pytest.raises(PlopError, match="too short") as caught:
        Recording(tmp_path / "one.h5")
    assert caught.value.found == "1 frame"


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


def test_names_of_no_episode_are_refused_and_globs_are_pointed_out() -> None:
    names = ["box_000", "box_001"]
    assert check_patterns(names, ["box_001", "*_000", "box_00[12]"], option="--test", where="raw") == []
    assert check_patterns(names, ["ball_*"], option="--test", where="raw") == ["--test ball_* matches no episode"]
    with pytest.raises(PlopError, match="no episode of this name") as caught:
        check_patterns(names, ["bx_001"], option="--test", where="raw")
    assert caught.value.fix == "Did you mean box_001 or box_000?" and caught.value.found == "--test bx_001"
