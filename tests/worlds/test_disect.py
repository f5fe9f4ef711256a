"""DiSECt as a foreign world: all that needs no simulator."""

from __future__ import annotations

import json
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.worlds import disect
from benchmarks.worlds.knife_cuts import (
    BELOW_M,
    FRAME_S,
    HIDEABLE,
    PUSH_S,
    SHAPES,
    Motion,
    cut_of,
    drawn,
    hide,
    object_mesh,
    time_step_s,
    tool_motion,
    world_of,
)
from plop.errors import PlopError

KNIFE = np.array([[-0.001, -0.075, 0.02], [0.001, -0.075, 0.02], [0.0, -0.075, -0.02], [0.0, 0.075, -0.02]])
MOTIONS = [Motion(0.02, 0.005, 0.4, 0.06, 0.07), Motion(-0.01, 0.0, 0.0, 0.05, -0.07)]


def _volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float(np.einsum("fi,fi", a, np.cross(b, c))) / 6


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("motion", MOTIONS)
def test_halves_are_closed_and_fill_the_object(shape, motion):
    mesh, cut = object_mesh(shape), cut_of(shape, motion)
    upper = cut.upper[cut.faces]
    assert (upper.all(1) | ~upper.any(1)).all()
    for part in (cut.faces[upper.all(1)], cut.faces[~upper.any(1)]):
        directed = part[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        assert len(np.unique(directed, axis=0)) == len(directed)
        assert set(map(tuple, directed)) == set(map(tuple, directed[:, ::-1]))
        assert _volume(cut.vertices, part) > 0
    assert_allclose(_volume(cut.vertices, cut.faces), _volume(mesh.nodes[mesh.surface], mesh.faces), rtol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_new_faces_coincide_and_look_at_each_other(shape):
    cut = cut_of(shape, MOTIONS[0])
    a, b, c = np.moveaxis(cut.vertices[cut.faces[cut.cut_faces]], 1, 0)
    assert_allclose(a @ cut.normal, cut.offset_m, atol=1e-12)
    away = np.cross(b - a, c - a) @ cut.normal
    assert_allclose(away[away > 0].sum(), -away[away < 0].sum(), rtol=1e-9)
    upper = cut.upper[cut.faces[cut.cut_faces, 0]]
    assert (away[upper] < 0).all() and (away[~upper] > 0).all()


def test_motions_repeat_whatever_is_hidden_and_stay_in_their_ranges():
    motions = [drawn(3, k) for k in range(200)]
    assert motions == [drawn(3, k) for k in range(200)] and drawn(4, 0) != motions[0]
    rows = np.abs([(m.x_m, m.y_m, m.yaw_rad, m.aside_m_s) for m in motions]).max(0)
    assert (rows <= [0.024, 0.008, np.deg2rad(25), 0.09]).all() and (rows > [0.02, 0.007, 0.4, 0.085]).all()
    assert all(0.04 <= m.down_m_s <= 0.07 and m.aside_m_s * m.x_m > 0 for m in motions)


def test_a_knife_goes_down_at_its_speed_and_then_aside_along_its_normal():
    motion = MOTIONS[0]
    cut = cut_of("prism", motion)
    tool = tool_motion(KNIFE, np.array([[0, 1, 2]]), motion, cut)
    places, last = tool.world_from_tool[:, :3, 3], round(PUSH_S / FRAME_S)
    assert places[0, 2] - 0.02 > 0.05
    assert_allclose(places[:-last] @ cut.normal, cut.offset_m, atol=1e-9)
    assert_allclose(np.diff(places[:-last, 2]), -motion.down_m_s * FRAME_S)
    assert_allclose(places[-1] - places[-1 - last], PUSH_S * motion.aside_m_s * cut.normal, atol=1e-12)
    assert_allclose(places[-1, 2], 0.02 - BELOW_M)


def test_hidden_numbers_change_only_what_they_name():
    world = world_of("sphere-foam")
    changed = hide(world, ["stiffness=1.5", "table_friction=0.2", "tilt_x_deg=-3"])
    assert (changed.youngs_modulus_pa, changed.table_friction) == (1.5 * world.youngs_modulus_pa, 0.2)
    assert changed.gravity_m_s2[0] < 0 and changed.density_kg_m3 == world.density_kg_m3
    assert hide(world, []) == world and time_step_s(changed) == time_step_s(world)
    for key, (field, is_factor) in HIDEABLE.items():
        assert getattr(hide(world, [f"{key}=2"]), field) == (2 * getattr(world, field) if is_factor else 2)


@pytest.mark.parametrize("text", ["stifness=2", "stiffness", "stiffness=soft", "density=-1", "damping=0", "=2"])
def test_what_cannot_be_hidden_is_refused(text):
    with pytest.raises(PlopError) as error:
        hide(world_of("prism-jelly"), [text])
    assert text in str(error.value)


def test_unknown_objects_and_folders_are_refused(tmp_path):
    with pytest.raises(PlopError):
        world_of("prism-putty")
    with pytest.raises(PlopError) as error:
        disect.main(["--simulator", str(tmp_path), "--out", str(tmp_path / "raw")])
    assert "git clone" in str(error.value) and not (tmp_path / "raw").exists()


def test_a_finished_episode_is_not_made_again_and_another_one_is_refused(tmp_path):
    world = world_of("prism-jelly")
    assert not disect._there(tmp_path, world, 3, 0)
    facts = {"world": asdict(world), "motion": asdict(drawn(3, 0))}
    (tmp_path / "prism_jelly_000.json").write_text(json.dumps({"facts": facts}))
    assert disect._there(tmp_path, world, 3, 0)
    for other, seed, said in ((hide(world, ["density=2"]), 3, "density_kg_m3 2300"), (world, 4, "x_m")):
        with pytest.raises(PlopError) as error:
            disect._there(tmp_path, other, seed, 0)
        assert said in str(error.value)


def test_vertices_are_followed_by_nodes_of_their_own_side():
    cut = cut_of("prism", MOTIONS[1])
    count, points = len(cut.mesh.nodes), cut.corners[cut.corners[:, 0] != cut.corners[:, 1]]
    copies = {node: count + k for k, node in enumerate(np.unique(points).tolist())}
    height = cut.mesh.nodes @ cut.normal - cut.offset_m
    share = height[points[:, 0]] / (height[points[:, 0]] - height[points[:, 1]])
    # every other edge is told from its far end, where its node is a copy
    turned = np.arange(len(points)) % 2 == 0
    own = np.stack([points[:, 0], [copies[node] for node in points[:, 1].tolist()]], 1)
    own[turned] = own[turned, ::-1]
    builder = SimpleNamespace(
        cut_duplicated_x=copies, cut_edge_indices=own, cut_edge_coords=np.where(turned, 1 - share, share)
    )
    ends, weights = disect._followed(builder, cut)
    nodes = np.concatenate([cut.mesh.nodes, cut.mesh.nodes[list(copies)]])
    found = nodes[ends[:, 0]] * (1 - weights[:, None]) + nodes[ends[:, 1]] * weights[:, None]
    assert_allclose(found, cut.vertices, atol=1e-12)
    builder.cut_edge_indices, builder.cut_edge_coords = own[1:], builder.cut_edge_coords[1:]
    with pytest.raises(PlopError):
        disect._followed(builder, cut)
