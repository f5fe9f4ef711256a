"""A tool's mesh that a damaged file left behind is refused; right but ugly ones pass with a note."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import Delaunay

from plop.errors import PlopError
from plop.geometry.meshes.mesh_topology import Topology, volumes, welded
from plop.geometry.meshes.tool_checks import check_tool_mesh
from plop.recordings.readers.droid.tool import tool_mesh


def _tools() -> dict[str, trimesh.Trimesh]:
    blade = trimesh.creation.box([0.12, 0.004, 0.05]).subdivide().subdivide()
    two = trimesh.util.concatenate([blade, blade.copy().apply_translation([0, 0.03, 0])])
    rod, cone = (make(0.01, 0.1, sections=32) for make in (trimesh.creation.cylinder, trimesh.creation.cone))
    ball = trimesh.creation.icosphere(2, radius=0.03)
    tools = {"blade": blade, "rod": rod, "fingers": two, "cone": cone, "ball": ball}
    return {name: tool.apply_translation([0.003, 0.02, 0.07]) for name, tool in tools.items()}


def _sheet(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """A flat sheet whose corner is the origin."""
    grid = np.stack(np.meshgrid(np.linspace(0, 0.1, columns), np.linspace(0, 0.05, rows)), -1).reshape(-1, 2)
    return np.c_[grid, 0 * grid[:, 0]], Delaunay(grid).simplices


@pytest.mark.parametrize("name", _tools())
@pytest.mark.parametrize("kind", ["stl", "obj", "ply"])
def test_a_file_that_lost_a_part_is_refused_and_the_whole_one_is_not(tmp_path: Path, name: str, kind: str) -> None:
    path = tmp_path / f"tool.{kind}"
    _tools()[name].export(path)
    whole = path.read_bytes()
    assert tool_mesh(path, "e")[1] == []
    lengths = {"stl": (60, 200), "obj": (20, 200), "ply": (100,)}[kind]
    starts = np.linspace(len(whole) // 3, len(whole) * 0.9, 5).astype(int) if kind != "ply" else [int(len(whole) * 0.9)]
    for length in lengths:
        for start in starts:
            path.write_bytes(whole[:start] + bytes(min(length, len(whole) - start)) + whole[start + length :])
            with pytest.raises(PlopError, match="damaged|not usable"):
                tool_mesh(path, "e")
    for share in (0.4, 0.6, 0.8):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(PlopError, match="damaged|not usable"):
            tool_mesh(path, "e")


@pytest.mark.parametrize("seed", range(3))
def test_lost_vertices_and_faces_of_arrays_are_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for tool in _tools().values():
        vertices, faces = np.array(tool.vertices), np.array(tool.faces)
        start = int(rng.integers(0, len(vertices) - 8))
        lost = vertices.copy()
        lost[start : start + 8] = 0
        with pytest.raises(PlopError, match="damaged"):
            check_tool_mesh(lost, faces, "tool")
        zeroed = faces.copy()
        zeroed[len(faces) // 4 : len(faces) // 2] = 0
        with pytest.raises(PlopError, match="damaged"):
            check_tool_mesh(vertices, zeroed, "tool")


def test_a_corner_or_a_vertex_astray_is_refused() -> None:
    tool = _tools()["blade"]
    vertices, faces = tool.vertices[tool.faces].reshape(-1, 3).copy(), np.arange(tool.faces.size).reshape(-1, 3)
    assert check_tool_mesh(vertices, faces, "tool") == []
    vertices[50] += [0.05, 0.05, 0.02]
    with pytest.raises(PlopError, match="1 of 192 triangles are stray"):
        check_tool_mesh(vertices, faces, "tool")
    with pytest.raises(PlopError, match="belong to none"):
        check_tool_mesh(np.r_[tool.vertices, [[0.5, 0.5, 0.5]]], np.array(tool.faces), "tool")


@pytest.mark.parametrize(("columns", "rows"), [(2, 2), (3, 3), (4, 4), (2, 3), (2, 20), (9, 7)])
def test_an_open_sheet_passes_with_a_note(columns: int, rows: int) -> None:
    notes = check_tool_mesh(*_sheet(columns, rows), "tool")
    assert len(notes) == 1 and "not closed" in notes[0]


def test_ugly_meshes_pass_with_a_note() -> None:
    tool = _tools()["blade"]
    vertices, faces = np.array(tool.vertices), np.array(tool.faces)
    edge = faces[7, :2]
    assert "2 collapsed" in check_tool_mesh(vertices, np.r_[faces, [[*edge, edge[1]], [edge[0], *edge]]], "tool")[0]
    assert "3 edges" in check_tool_mesh(vertices, faces[1:], "tool")[0], "one triangle missing: a hole, nothing astray"
    assert "inconsistently" in check_tool_mesh(vertices, np.r_[faces[:9, ::-1], faces[9:]], "tool")[0]
    rod = _tools()["rod"]
    open_rod = np.array(rod.faces)[np.abs(rod.face_normals[:, 2]) < 0.5]
    assert "not closed" in check_tool_mesh(np.array(rod.vertices), open_rod, "tool")[0]


def test_turning_makes_neighbours_agree_whatever_was_reversed() -> None:
    ball = trimesh.creation.icosphere(2)
    faces = np.array(ball.faces)
    reversed_ = np.random.default_rng(0).random(len(faces)) < 0.4
    faces[reversed_] = faces[reversed_][:, ::-1]
    topology = Topology.of(welded(np.array(ball.vertices), faces))
    assert topology.is_closed and topology.orientable and topology.piece.max() == 0
    faces[topology.turned] = faces[topology.turned][:, ::-1]
    volume = volumes(np.array(ball.vertices), faces, topology.piece)
    assert abs(volume[0]) == pytest.approx(ball.volume)


def test_a_strip_with_a_half_twist_has_no_outside() -> None:
    count = 12
    low, high = np.arange(count), np.arange(count) + count
    after_low, after_high = np.r_[low[1:], high[0]], np.r_[high[1:], low[0]]
    faces = np.concatenate([np.stack([low, after_low, high], 1), np.stack([high, after_low, after_high], 1)])
    assert not Topology.of(faces).orientable
