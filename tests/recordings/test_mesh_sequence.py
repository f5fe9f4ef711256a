"""A mesh sequence survives the round trip; contradictions are refused by name."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from plop.errors import PlopError
from plop.recordings.readers.mesh.sequence import (
    begun_at_rest,
    list_mesh_sequences,
    read_mesh_sequence,
    write_mesh_sequence,
)
from tests.support.box_sequence import box_sequence


def test_reads_back_what_was_written(tmp_path: Path) -> None:
    sequence = box_sequence()
    found = read_mesh_sequence(write_mesh_sequence(tmp_path, sequence))
    for key, value in vars(sequence).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(getattr(found, key), value, atol=1e-8, err_msg=key)
    assert (found.name, found.environment, found.table_z_m) == (sequence.name, "box", 0.0)
    assert found.facts == sequence.facts
    np.testing.assert_array_equal(found.truth["nodes_m"], sequence.truth["nodes_m"])


def test_same_sequence_gives_the_same_bytes(tmp_path: Path) -> None:
    one, two = (write_mesh_sequence(tmp_path / folder, box_sequence()) for folder in "ab")
    assert one.read_bytes() == two.read_bytes()
    assert one.with_suffix(".json").read_bytes() == two.with_suffix(".json").read_bytes()


def test_what_is_optional_has_a_meaning_when_absent(tmp_path: Path) -> None:
    bare = dataclasses.replace(box_sequence(), rest_vertices=None, cut_faces=None, table_z_m=None, truth={})
    found = read_mesh_sequence(write_mesh_sequence(tmp_path, bare))
    np.testing.assert_allclose(found.rest, bare.vertices[0], atol=1e-8)
    assert not found.is_cut_face.any() and found.table_z_m is None and found.truth == {}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": np.array([0.0, 0.1])}, "inconsistent"),
        ({"times": np.array([0.0, 0.1, 0.1])}, "Time does not increase"),
        ({"world_from_tool": np.tile(np.eye(4), (2, 1, 1))}, "inconsistent"),
        ({"rest_vertices": np.zeros((3, 3))}, "inconsistent"),
        ({"cut_faces": np.zeros(2, bool)}, "inconsistent"),
        ({"world_from_tool": np.tile(np.diag([2.0, 2, 2, 1]), (3, 1, 1))}, "not a rotation"),
        ({"world_from_tool": np.tile(np.diag([0.0, 0, 0, 1]), (3, 1, 1))}, "not a rotation"),
        ({"world_from_tool": np.tile(np.diag([1.0, -1, 1, 1]), (3, 1, 1))}, "mirrored"),
        ({"world_from_tool": np.tile(np.eye(4) + np.eye(4)[[3]].T * [0.1, 0, 0, 0], (3, 1, 1))}, "last row"),
        ({"vertices": np.full((3, 16, 3), np.nan)}, "NaN"),
        ({"faces": np.array([[0, 1, 99]]), "cut_faces": None}, "does not exist"),
        ({"tool_faces": np.array([[0, 1, -1]])}, "does not exist"),
        ({"faces": np.zeros((0, 3), int), "cut_faces": None}, "inconsistent"),
    ],
)
def test_contradictions_are_refused(tmp_path: Path, change: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(PlopError, match=message):
        write_mesh_sequence(tmp_path, dataclasses.replace(box_sequence(), **change))
    assert not list(tmp_path.iterdir())


def test_missing_damaged_and_newer_files_are_named(tmp_path: Path) -> None:
    path = write_mesh_sequence(tmp_path, box_sequence())
    whole, side = path.read_bytes(), path.with_suffix(".json").read_text()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(PlopError, match="damaged"):
        read_mesh_sequence(path)
    path.write_bytes(whole)
    path.with_suffix(".json").write_text(json.dumps({**json.loads(side), "schema": 99}))
    with pytest.raises(PlopError, match="newer version"):
        read_mesh_sequence(path)
    path.with_suffix(".json").unlink()
    with pytest.raises(PlopError, match="JSON file is missing"):
        read_mesh_sequence(path)
    np.savez(path, times=np.zeros(1))
    path.with_suffix(".json").write_text(side)
    with pytest.raises(PlopError, match="incomplete"):
        read_mesh_sequence(path)


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PlopError, match="no mesh sequences"):
        list_mesh_sequences(tmp_path)


def test_an_episode_is_led_back_to_rest() -> None:
    first = box_sequence()
    rate = first.times[1] - first.times[0]
    late = dataclasses.replace(first, times=first.times - first.times[0] + rate, rest_vertices=first.vertices[0] + 0.01)
    begun = begun_at_rest(late)
    assert begun.times[0] == 0 and len(begun.times) == len(late.times) + 1
    np.testing.assert_allclose(begun.vertices[0], late.rest_vertices)
    path = begun.world_from_tool[:3, :3, 3]
    np.testing.assert_allclose(path[1] - path[0], path[2] - path[1], atol=1e-9)
    nodes = {"nodes_m": late.vertices.astype(np.float32), "rest_nodes_m": late.rest.astype(np.float32)}
    tets = np.zeros((len(late), 4), int)
    truth = begun_at_rest(dataclasses.replace(late, truth=nodes | {"tets": tets})).truth
    assert truth["nodes_m"].dtype == np.float32 and len(truth["nodes_m"]) == len(begun)
    np.testing.assert_array_equal(truth["nodes_m"][0], nodes["rest_nodes_m"])
    np.testing.assert_array_equal(truth["nodes_m"][1:], nodes["nodes_m"])
    assert truth["tets"] is tets, "what has no rest is not over time"
    early = dataclasses.replace(late, times=late.times - late.times[0])
    assert begun_at_rest(early) is early


@pytest.mark.parametrize(
    ("height", "said"), [("zero", "'zero'"), (True, "True"), ([0.0], "[0.0]"), (float("nan"), "nan")]
)
def test_a_table_that_has_no_height_is_named(tmp_path: Path, height: object, said: str) -> None:
    path = write_mesh_sequence(tmp_path, box_sequence())
    side = path.with_suffix(".json")
    side.write_text(json.dumps({**json.loads(side.read_text()), "table_z_m": height}))
    with pytest.raises(PlopError) as caught:
        read_mesh_sequence(path)
    assert caught.value.where == f"{side}: table_z_m" and caught.value.found == said


@pytest.mark.parametrize(
    ("content", "where", "expected", "found"),
    [
        ([], "", "an object", "a list: []"),
        ({"schema": "1"}, ": schema", "a whole number", 'a text: "1"'),
        ({"environment": 3}, ": environment", "a text", "a whole number: 3"),
        ({"environment": None}, ": environment", "a text", "null: null"),
        ({"facts": []}, ": facts", "an object", "a list: []"),
        ({"source": {}}, ": source", "a text", "an object: {}"),
    ],
)
def test_a_side_file_of_the_wrong_shape_is_named(
    tmp_path: Path, content: object, where: str, expected: str, found: str
) -> None:
    path = write_mesh_sequence(tmp_path, box_sequence())
    side = path.with_suffix(".json")
    side.write_text(json.dumps({"environment": "box", **content} if isinstance(content, dict) else content))
    with pytest.raises(PlopError, match="wrong type") as caught:
        read_mesh_sequence(path)
    assert (caught.value.where, caught.value.expected, caught.value.found) == (f"{side}{where}", expected, found)


@pytest.mark.parametrize(
    ("key", "change", "found"),
    [
        ("times", lambda array: array.astype(str), "<U"),
        ("faces", lambda array: np.float64(1), "float64, a single value"),
        ("vertices", lambda array: array.reshape(-1), "float32, 144"),
        ("world_from_tool", lambda array: array[:, :3], "3 x 3 x 4"),
        ("tool_faces", lambda array: array[:0], "none"),
    ],
)
def test_an_array_of_another_shape_or_kind_is_named(
    tmp_path: Path, key: str, change: Callable[[np.ndarray], np.ndarray], found: str
) -> None:
    path = write_mesh_sequence(tmp_path, box_sequence())
    arrays = dict(np.load(path))
    np.savez(path, **{**arrays, key: change(arrays[key])})
    with pytest.raises(PlopError, match="unexpected shape or type") as caught:
        read_mesh_sequence(path)
    assert caught.value.where == f"{path}: {key}" and found in str(caught.value.found)


def test_an_episode_that_tells_no_environment_is_named(tmp_path: Path) -> None:
    path = write_mesh_sequence(tmp_path, box_sequence())
    path.with_suffix(".json").write_text("{}")
    with pytest.raises(PlopError, match="has no environment"):
        read_mesh_sequence(path)
    assert [entry.guessed for entry in list_mesh_sequences(tmp_path)] == [True]
