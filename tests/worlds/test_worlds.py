"""Foreign worlds: what they are given needs no simulator; what they give is plop's raw recording."""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.worlds import needs
from benchmarks.worlds.laws import on_a_tilt, refined, slide
from benchmarks.worlds.scene import KINDS, Motion, TetrahedralMesh, World, node_volumes, tetrahedral_mesh, tool_motion
from plop.errors import PlopError
from plop.physics.scenes.shapes import Shape
from plop.recordings.readers.mesh.sequence import check_mesh_sequence, read_mesh_sequence, write_mesh_sequence
from plop.tracking.episode import episode_from_sequence

WORLDS = {
    "block": World(cells_m=0.013),
    "cylinder": World("cylinder", Shape("cylinder", (0.05, 0.05, 0.035)), cells_m=0.012),
    "cake": World("cake", taper=0.3, cells_m=0.013),
}
PACKAGES = {"drake": "pydrake", "mujoco": "mujoco"}


def _volume(mesh: TetrahedralMesh) -> float:
    corner = mesh.nodes[mesh.surface][mesh.faces]
    return float(np.einsum("fi,fi", corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))) / 6


@pytest.mark.parametrize("name", WORLDS)
def test_tetrahedra_fill_their_closed_surface(name):
    mesh = tetrahedral_mesh(WORLDS[name])
    edges = mesh.nodes[mesh.tetrahedra[:, 1:]] - mesh.nodes[mesh.tetrahedra[:, :1]]
    volumes = np.linalg.det(edges) / 6
    assert volumes.min() > 0.02 * volumes.mean()
    assert_allclose(volumes.sum(), _volume(mesh), rtol=1e-9)
    assert_allclose(node_volumes(mesh).sum(), _volume(mesh), rtol=1e-9)
    sides = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1)
    assert (np.unique(sides, axis=0, return_counts=True)[1] == 2).all()


def test_a_mesh_prefers_no_side():
    mesh = tetrahedral_mesh(World(cells_m=0.010))
    own = {tuple(row) for row in np.sort(mesh.tetrahedra, 1)}
    mirrored = np.round(mesh.nodes * [-1, 1, 1], 9)
    number = {tuple(place): k for k, place in enumerate(np.round(mesh.nodes, 9) + 0.0)}
    other = np.array([number[tuple(place + 0.0)] for place in mirrored])
    assert own == {tuple(row) for row in np.sort(other[mesh.tetrahedra], 1)}


@pytest.mark.parametrize("kind", KINDS)
def test_a_tool_starts_clear_of_the_object(kind):
    world, motion = WORLDS["block"], Motion(kind, x_m=0.006, y_m=-0.004, yaw_rad=0.3)
    tool = tool_motion(world, motion)
    corners = tool.vertices @ tool.world_from_tool[0, :3, :3].T + tool.world_from_tool[0, :3, 3]
    along = np.array([np.cos(0.3), np.sin(0.3), 0])
    clear_above = corners[:, 2].min() > world.shape.height_m
    assert clear_above or (corners @ along).max() < -world.shape.reach_m(along[:2])


def test_gravity_leans_and_keeps_its_size():
    gravity = World(tilt_deg=(9.0, 0.0)).gravity_m_s2
    assert_allclose(np.linalg.norm(gravity), 9.81)
    assert_allclose(np.degrees(np.arctan2(gravity[0], -gravity[2])), 9.0)


def test_friction_is_read_off_a_way_downhill():
    times, tilt = np.linspace(0.1, 0.5, 13), np.deg2rad(20)
    pull, damping = 9.81 * (np.sin(tilt) - 0.2 * np.cos(tilt)), 2.0
    # the solution of x'' + d x' = a from rest at time 0
    way = pull / damping * (times - (1 - np.exp(-damping * times)) / damping)
    assert abs(slide(times, way, tilt, damping).friction - 0.2) < 2e-3


def test_a_motion_on_a_finer_mesh_is_compared_at_the_nearest_nodes():
    def record(world: World, motion: Motion) -> SimpleNamespace:
        """Shift the object by the edge of a cell."""
        rest = tetrahedral_mesh(world).nodes
        return SimpleNamespace(rest=rest, vertices=np.stack([rest, rest + [world.cells_m, 0, 0]]))

    apart, moved = refined(record, World(cells_m=0.010), Motion("drag"), 0.005)
    assert (apart, moved) == pytest.approx((0.005 / 2**0.5, 0.010 / 2**0.5))


def test_a_missing_simulator_names_the_extra(monkeypatch):
    def absent(module):
        raise ImportError(f"No module named {module!r}")

    monkeypatch.setattr(needs.importlib, "import_module", absent)
    with pytest.raises(PlopError) as error:
        needs.needed("pydrake.geometry")
    assert "[worlds]" in str(error.value) and error.value.where == "pydrake"


def test_unknown_words_are_refused():
    with pytest.raises(PlopError):
        Motion("stroke")
    with pytest.raises(PlopError):
        importlib.import_module("benchmarks.worlds.drake").record(World(law="putty"), Motion())


def _simulator(name: str):
    if importlib.util.find_spec(PACKAGES[name]) is None:
        pytest.skip(f"{PACKAGES[name]} is not installed: pip install -e '.[worlds]'")
    return importlib.import_module(f"benchmarks.worlds.{name}").record


@pytest.mark.parametrize("name", PACKAGES)
def test_a_press_becomes_a_recording(name, tmp_path):
    record, world = _simulator(name), replace(WORLDS["block"], time_step_s=0.005)
    sequence = record(world, Motion("press", depth_m=0.006, x_m=0.0))
    check_mesh_sequence(sequence, name)
    again = read_mesh_sequence(write_mesh_sequence(tmp_path, sequence))
    assert again.facts["world"]["youngs_modulus_pa"] == world.youngs_modulus_pa
    force = np.array(again.facts["tool_force_n"])
    assert force.shape == (len(sequence.times), 3) and np.abs(force[0]).max() < 1e-6 < 0.5 < -force[:, 2].min()
    sunk = sequence.vertices[0, :, 2].max() - sequence.vertices[:, :, 2]
    under = np.linalg.norm(sequence.rest - [0, 0, 0.04], axis=1).argmin()
    assert 0.004 < sunk[:, under].max() < 0.008
    assert episode_from_sequence(again, noise_m=1e-4).motion.shape[0] == len(sequence.times)


@pytest.mark.parametrize("name", PACKAGES)
def test_a_block_sticks_on_a_gentle_tilt(name):
    record, world = _simulator(name), replace(WORLDS["block"], time_step_s=0.005)
    assert abs(on_a_tilt(record, world, 9.0).speed_m_s) < 0.001
