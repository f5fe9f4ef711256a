"""The recordings that the project makes for itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from plop.physics.scenes import demo
from plop.recordings.readers.mesh.sequence import MeshSequence, read_mesh_sequence, write_mesh_sequence


@pytest.fixture(scope="module")
def plan() -> demo.CutPlan:
    return demo.draw_plan(np.random.default_rng([0, 0]))


@pytest.fixture(scope="module")
def episode(plan) -> MeshSequence:
    return demo.demo_episode("demo_000", plan)


@pytest.mark.parametrize("frame", [0, 10, -1])
def test_surface_is_closed_outward_and_keeps_its_volume(episode, frame):
    mesh = trimesh.Trimesh(episode.vertices[frame], episode.faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(np.prod(demo.BLOCK_M), rel=0.03)
    assert trimesh.Trimesh(episode.tool_vertices, episode.tool_faces, process=False).volume > 0


def test_one_half_is_pushed_and_the_other_stays(episode, plan):
    normal = np.array([np.cos(plan.yaw_rad), np.sin(plan.yaw_rad), 0])
    plane = plan.offset_m * normal[0]
    halves = list(trimesh.graph.connected_components(trimesh.graph.face_adjacency(episode.faces)))
    assert len(halves) == 2
    moved = (episode.vertices[-1] - episode.vertices[0]) @ normal
    for faces in halves:
        vertices = np.unique(episode.faces[faces])
        ahead = (episode.rest[vertices] @ normal).mean() > plane
        if ahead == (plan.push_m > 0):
            assert moved[vertices].mean() == pytest.approx(plan.push_m, abs=0.003)
        else:
            assert abs(moved[vertices].mean()) < 0.003


def test_new_faces_are_hidden_before_and_open_after(episode):
    cut = episode.cut_faces
    area = 2 * demo.BLOCK_M[1] * demo.BLOCK_M[2]
    corners = episode.rest[episode.faces[cut]]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(crossed, axis=1).sum() / 2 == pytest.approx(area, rel=0.05)
    on_cut = np.unique(episode.faces[cut])
    assert np.ptp(episode.vertices[-1][on_cut, 0]) > np.ptp(episode.vertices[0][on_cut, 0]) + 0.015


def test_same_plan_same_bytes(episode, plan, tmp_path, monkeypatch):
    write_mesh_sequence(tmp_path / "a", episode)
    back = read_mesh_sequence(tmp_path / "a" / "demo_000.npz")
    np.testing.assert_allclose(back.vertices, episode.vertices, atol=1e-6)
    monkeypatch.setattr(demo, "_SPACING_M", 0.01)
    for name in ("b", "c"):
        write_mesh_sequence(tmp_path / name, demo.demo_episode("demo_000", replace(plan)))
    for kind in ("npz", "json"):
        assert (tmp_path / f"b/demo_000.{kind}").read_bytes() == (tmp_path / f"c/demo_000.{kind}").read_bytes()


def test_folder_gets_all_episodes(tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "_SPACING_M", 0.0125)
    told = []
    demo.make_demo_recordings(tmp_path, seed=3, progress=lambda done, total, label: told.append((done, total, label)))
    names = [f"demo_{k:03d}" for k in range(demo.DEMO_TRAIN + demo.DEMO_TEST)]
    assert sorted(path.stem for path in tmp_path.glob("*.npz")) == names
    assert told[-1] == (len(names), len(names), names[-1])
