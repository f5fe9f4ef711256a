"""Simulated episodes that cannot be used: refused by file and key, or left out with their reason."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from plop.errors import PlopError
from plop.pipeline.settings import resolve
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.recordings.set import RecordingSet
from stages.ingest.settings import MeshConfig
from tests.ingest.simulated_runs import BOX, SMALL, filmed, ingest, payload, raw_folder
from tests.support.box_sequence import box_sequence


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
