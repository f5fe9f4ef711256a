"""DiSECt's files become metres with z up, contradictions are refused, and the real ones are what they claim."""

from __future__ import annotations

import builtins
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from plop.errors import PlopError
from plop.recordings.readers.declared_units import WORLD_FROM_UP
from plop.recordings.readers.disect.episode import list_disect, read_disect
from tests.recordings import disect_sample as sample

Z_UP_FROM_Y_UP = WORLD_FROM_UP["y"]

pytest.importorskip("pxr", reason="usd-core (the extra `disect`) is not installed")


def test_the_turn_from_y_up_to_z_up_is_a_rotation() -> None:
    assert np.linalg.det(Z_UP_FROM_Y_UP) == pytest.approx(1)
    np.testing.assert_array_equal(Z_UP_FROM_Y_UP @ [1, 2, 3], [1, -3, 2])


def test_reads_nodes_surface_and_knife_with_z_up(tmp_path: Path) -> None:
    sequence = read_disect(sample.write_sample(tmp_path))
    assert sequence.environment == "pyramid-jelly" and sequence.table_z_m == 0
    np.testing.assert_allclose(sequence.times, sample.TIMES)
    np.testing.assert_allclose(sequence.vertices[:, 4, 2], [0.03, 0.029, 0.028], atol=1e-6)
    np.testing.assert_allclose(sequence.world_from_tool[:, :3, 3], sample.knife_positions() @ Z_UP_FROM_Y_UP.T)
    assert sequence.vertices.shape[1] == 5, "the virtual node is no part of the surface"
    np.testing.assert_array_equal(sequence.truth["node_is_real"], [True] * 5 + [False])
    assert sequence.truth["nodes_m"].shape == (3, 6, 3)


def test_cut_vertices_follow_their_edge(tmp_path: Path) -> None:
    arrays = sample.side_arrays()
    arrays["surface_clean"] = np.array([[0, 6, 7], [4, 1, 2], [6, 7, 6]])
    sequence = read_disect(sample.write_sample(tmp_path, arrays=arrays))
    start, end = (sample.NODES[i] @ Z_UP_FROM_Y_UP.T for i in (3, 2))
    cut = sequence.vertices[0][sequence.faces[0, 2]]
    np.testing.assert_allclose(cut, 0.75 * start + 0.25 * end, atol=1e-6)
    np.testing.assert_array_equal(sequence.is_cut_face, [False, False, True])


def test_a_tilted_knife_keeps_its_points_in_the_world(tmp_path: Path) -> None:
    from scipy.spatial.transform import Rotation

    arrays = sample.side_arrays()
    turn = Rotation.from_euler("xyz", [0.1, 0.4, -0.2])
    arrays["knife_quaternion_xyzw"] = np.tile(turn.as_quat(), (sample.FRAMES, 1)).astype(np.float32)
    sequence = read_disect(sample.write_sample(tmp_path, arrays=arrays))
    expected = (turn.apply(sample.BLADE) + sample.knife_positions()[1]) @ Z_UP_FROM_Y_UP.T
    pose = sequence.world_from_tool[1]
    np.testing.assert_allclose(sequence.tool_vertices @ pose[:3, :3].T + pose[:3, 3], expected, atol=1e-6)


def _drop(suffix: str) -> Callable[[Path], None]:
    return lambda path: path.with_suffix(suffix).unlink()


def _truncate(suffix: str) -> Callable[[Path], None]:
    def cut(path: Path) -> None:
        path = path.with_suffix(suffix)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    return cut


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (_drop(".npz"), "npz file is missing"),
        (_drop(".json"), "JSON file is missing"),
        (_drop(".usd"), "USD file is missing"),
        (_truncate(".npz"), "npz file is missing or damaged"),
        (_truncate(".json"), "JSON file is missing or damaged"),
        (_truncate(".usd"), "USD file is missing or damaged"),
    ],
)
def test_missing_and_truncated_files_are_named(tmp_path: Path, harm: Callable[[Path], None], message: str) -> None:
    path = sample.write_sample(tmp_path)
    harm(path)
    with pytest.raises(PlopError, match=message) as caught:
        read_disect(path)
    assert caught.value.fix and path.stem in str(caught.value.where)


@pytest.mark.parametrize(
    ("change", "where", "found"),
    [
        ([], "", "a list: []"),
        ({"units": "m"}, ": units", 'a text: "m"'),
        ({"settings": []}, ": settings", "a list: []"),
        ({"environment": ["jelly"]}, ": environment", 'a list: ["jelly"]'),
        ({"shape": 1, "material": "jelly"}, ": shape", "a whole number: 1"),
    ],
)
def test_json_of_the_wrong_shape_is_named_by_its_key(tmp_path: Path, change: object, where: str, found: str) -> None:
    path = sample.write_sample(tmp_path)
    side = path.with_suffix(".json")
    side.write_text(json.dumps({**json.loads(side.read_text()), **change} if isinstance(change, dict) else change))
    with pytest.raises(PlopError, match="wrong type") as caught:
        read_disect(path)
    assert (caught.value.where, caught.value.found) == (f"{side}{where}", found) and caught.value.expected
    assert [entry.guessed for entry in list_disect(tmp_path)] == [True]


@pytest.mark.parametrize(
    ("key", "change", "problem"),
    [
        ("times", lambda array: array[:0], "unexpected shape"),
        ("knife_vertices", lambda array: array.ravel(), "another"),
        ("surface_clean", lambda array: array + 0.5, "unexpected shape or type"),
        ("tets", lambda array: array.astype(str), "unexpected shape or type"),
        ("surface_clean", lambda array: array - 9, "belong together"),
        ("cut_edge_indices", lambda array: array + 99, "belong together"),
    ],
)
def test_an_array_of_another_shape_or_kind_is_named(
    tmp_path: Path, key: str, change: Callable[[np.ndarray], np.ndarray], problem: str
) -> None:
    arrays = sample.side_arrays()
    path = sample.write_sample(tmp_path, arrays={**arrays, key: change(arrays[key])})
    with pytest.raises(PlopError, match=problem) as caught:
        read_disect(path)
    assert str(caught.value.where).endswith(f": {key}") and caught.value.expected and caught.value.found


def test_files_of_different_recordings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PlopError, match="belong together") as caught:
        read_disect(sample.write_sample(tmp_path, times=sample.TIMES[:2]))
    assert "3 up to" in caught.value.expected and "2 up to" in caught.value.found
    with pytest.raises(PlopError, match="belong together"):
        read_disect(sample.write_sample(tmp_path, "b_000", nodes=sample.node_positions()[:, :4]))
    with pytest.raises(PlopError, match="belong together"):
        read_disect(sample.write_sample(tmp_path, "c_000", knife=sample.knife_positions() + 0.01))


def test_nan_is_refused_wherever_it_hides(tmp_path: Path) -> None:
    nodes = sample.node_positions()
    nodes[1, 5, 0] = np.nan
    with pytest.raises(PlopError, match="NaN"):
        read_disect(sample.write_sample(tmp_path, nodes=nodes))
    arrays = sample.side_arrays()
    arrays["knife_position"][2, 1] = np.inf
    with pytest.raises(PlopError, match="NaN"):
        read_disect(sample.write_sample(tmp_path, "b_000", arrays=arrays))


def test_pickles_in_the_npz_are_not_opened(tmp_path: Path) -> None:
    path = sample.write_sample(tmp_path, arrays={**sample.side_arrays(), "tets": np.array([{}, None], object)})
    with pytest.raises(PlopError, match="npz"):
        read_disect(path)


def test_without_usd_core_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = sample.write_sample(tmp_path)
    real = builtins.__import__

    def without_pxr(name: str, *args: object, **kwargs: object) -> object:
        if name.startswith("pxr"):
            raise ImportError("No module named 'pxr'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without_pxr)
    with pytest.raises(PlopError, match="usd-core") as caught:
        read_disect(path)
    assert "[disect]" in caught.value.fix


def test_a_bad_json_does_not_hide_the_other_recordings(tmp_path: Path) -> None:
    sample.write_sample(tmp_path)
    _truncate(".json")(sample.write_sample(tmp_path, "block_foam_part_001"))
    assert [(e.name, e.environment) for e in list_disect(tmp_path)] == [
        ("block_foam_part_001", "block-foam"),
        ("pyramid_jelly_part_000", "pyramid-jelly"),
    ]


@pytest.mark.parametrize("name", ["prism_jelly_part_000", "sphere_foam_part_004", "cylinder_polymer_001"])
def test_real_recordings_hold_what_their_json_claims(shared_data: Path, name: str) -> None:
    import trimesh

    sequence = read_disect(shared_data / "disect" / f"{name}.usd")
    first, last = (trimesh.Trimesh(sequence.vertices[t], sequence.faces, process=False) for t in (0, -1))
    assert first.is_watertight and last.is_watertight and first.volume > 0
    checks = sequence.facts["checks"]
    assert last.volume / trimesh.Trimesh(sequence.rest, sequence.faces, process=False).volume == pytest.approx(
        checks["volume_ratio"], abs=0.005
    )
    assert len(last.split(only_watertight=False)) == 2, "the cut makes two halves"
    nodes = sequence.truth["nodes_m"]
    assert nodes.shape[1] == sequence.facts["counts"]["nodes"]
    assert sequence.truth["node_is_real"].sum() == sequence.facts["counts"]["nodes_uncut"]
    assert nodes[:, sequence.truth["node_is_real"], 2].min() * 1000 == pytest.approx(checks["min_y_mm"], abs=0.5)
    assert -0.010 < (sequence.tool_vertices[:, 2].min() + sequence.world_from_tool[:, 2, 3]).min() < -0.006


def test_a_recording_that_hides_its_settings_is_named_by_shape_and_material(tmp_path: Path) -> None:
    path = sample.write_sample(tmp_path)
    side = json.loads(path.with_suffix(".json").read_text())
    del side["environment"]
    path.with_suffix(".json").write_text(json.dumps({**side, "shape": "prism", "material": "jelly"}))
    assert read_disect(path).environment == "prism-jelly"


def test_a_zero_quaternion_is_named(tmp_path: Path) -> None:
    arrays = sample.side_arrays()
    arrays["knife_quaternion_xyzw"][1] = 0
    path = sample.write_sample(tmp_path, arrays=arrays)
    with pytest.raises(PlopError) as caught:
        read_disect(path)
    assert caught.value.where == f"{path.with_suffix('.npz')}: knife_quaternion_xyzw"
    assert "1 of 3 frames, the first is 1" in str(caught.value.found)
