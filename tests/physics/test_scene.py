"""Scenes: closed halves that coincide, motions that do what their name says, the same numbers again, bad input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from plop.errors import PlopError
from plop.physics.effects.library import effect_type
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import ElasticLaw
from plop.physics.engine.solver import simulate
from plop.physics.scenes import find_scene, shipped_scenes
from plop.physics.scenes import scene as scene_module
from plop.physics.scenes.motions import CUTS, MOTIONS, PRESSES, MotionRanges, tool_motion
from plop.physics.scenes.scene import Scene, settled, simulate_episode
from plop.physics.scenes.shapes import Shape, halved_body, whole_body
from plop.recordings.readers.mesh.sequence import check_mesh_sequence

SHAPES = {"block": Shape(), "sphere": Shape("sphere", (0.06,) * 3), "cylinder": Shape("cylinder", (0.06, 0.06, 0.04))}
VOLUMES_M3 = {"block": 0.08 * 0.05 * 0.04, "sphere": 4 / 3 * np.pi * 0.03**3, "cylinder": np.pi * 0.03**2 * 0.04}
COARSE = Scene(spacing_m=0.01, dx_m=0.02, episodes=2, motions=("hold", "cut-push"))


@pytest.mark.parametrize("kind", SHAPES)
def test_whole_and_halves_are_closed_and_hold_the_same_volume(kind):
    shape = SHAPES[kind]
    whole = whole_body(shape, 0.004)
    halves = halved_body(shape, 0.004, 0.007, np.deg2rad(12))
    for body, parts in ((whole, 1), (halves, 2)):
        mesh = trimesh.Trimesh(body.particles.positions[body.surface], body.faces, process=False)
        assert mesh.is_watertight and mesh.is_winding_consistent
        assert len(list(trimesh.graph.connected_components(mesh.face_adjacency))) == parts
        assert mesh.volume == pytest.approx(VOLUMES_M3[kind], rel=0.02)
        assert body.particles.volumes.sum() == pytest.approx(mesh.volume, rel=2e-3)
        assert body.particles.positions[:, 2].min() == pytest.approx(0, abs=1e-4)
    assert not whole.cut_faces.any()


@pytest.mark.parametrize("kind", SHAPES)
def test_the_two_cut_faces_lie_in_the_blades_plane_and_coincide(kind):
    offset, yaw = 0.007, np.deg2rad(12)
    body = halved_body(SHAPES[kind], 0.004, offset, yaw)
    normal = np.array([np.cos(yaw), np.sin(yaw), 0])
    points, sides = body.particles.positions[body.surface], body.particles.sides[body.surface]
    on_cut = np.unique(body.faces[body.cut_faces])
    np.testing.assert_allclose(points[on_cut] @ normal, offset * np.cos(yaw), atol=1e-9)
    one, other = (np.unique(points[on_cut][sides[on_cut] == side].round(9), axis=0) for side in (-1, 1))
    np.testing.assert_allclose(one, other, atol=2e-9)
    assert ((points @ normal - offset * np.cos(yaw)) * sides > -1e-9).all()


@pytest.mark.parametrize("kind", MOTIONS)
def test_motions_do_what_their_name_says(kind):
    scene = Scene(motions=(kind,))
    for k in range(3):
        plan = scene.motion_plan(k)
        motion = tool_motion(plan, scene.shape, scene.frame_rate_hz)
        lower_end, height = motion.world_from_tool[:, :3, 3], scene.shape.height_m
        speed = np.linalg.norm(np.diff(lower_end, axis=0), axis=1) * scene.frame_rate_hz
        assert speed.max() <= max(plan.speed_m_s, plan.aside_speed_m_s) + 1e-9
        if kind in PRESSES:
            assert lower_end[:, 2].min() >= height - plan.depth_m - 1e-9
            assert lower_end[:, 2].min() < height
            turns = np.diff(np.sign(np.diff(lower_end[:, 2])[np.diff(lower_end[:, 2]) != 0]))
            assert np.count_nonzero(turns) == {"press": 0, "hold": 0, "retract": 1, "cycles": 3}[kind]
        elif kind in CUTS:
            assert lower_end[:, 2].min() < 0 and plan.tool == "blade"
            assert (lower_end[-1, 2] > height) == (kind in ("cut-retract", "cut-draw"))
            rise = np.diff(lower_end[:, 2]).max() * scene.frame_rate_hz
            fall = -np.diff(lower_end[:, 2]).min() * scene.frame_rate_hz
            assert kind != "cut-draw" or 0 < rise < 0.5 * fall
        aside = np.linalg.norm(lower_end[-1, :2] - lower_end[0, :2])
        expected = {"cut-push": abs(plan.aside_m), "push": plan.aside_m + 0.004}.get(kind, 0.0)
        assert aside == pytest.approx(expected, abs=1e-6)


def test_a_push_starts_clear_of_every_shape_and_goes_through_its_middle():
    for shape in SHAPES.values():
        scene = Scene(shape=shape, motions=("push",))
        body = whole_body(shape, 0.004)
        for k in range(4):
            plan = scene.motion_plan(k)
            motion = tool_motion(plan, shape, 30.0)
            points = body.particles.positions @ motion.world_from_tool[0, :3, :3]
            start = motion.world_from_tool[0, :3, 3] @ motion.world_from_tool[0, :3, :3]
            gap = points[:, 0].min() - (start[0] + motion.vertices[:, 0].max())
            assert gap == pytest.approx(0.004, abs=5e-4)


@pytest.fixture(scope="module")
def episodes():
    return [simulate_episode(COARSE, k) for k in range(2)]


def test_the_object_starts_at_rest_then_dents_or_opens(episodes):
    hold, cut = episodes
    for sequence in episodes:
        check_mesh_sequence(sequence, "episode")
        sag = sequence.rest[:, 2].max() - sequence.vertices[0][:, 2].max()
        assert 1e-4 < sag < 2e-3, "the weight of 40 mm of gel at 15 kPa: rho g h^2 / 2 E = 0.5 mm"
        drift = np.abs(sequence.vertices[1] - sequence.vertices[0]).max()
        assert drift < 3e-4, "nothing moves before the tool comes"
    under = np.abs(hold.rest[:, :2]).max(1) < 0.01
    dent = (hold.vertices[0] - hold.vertices[-1])[under & (hold.rest[:, 2] > 0.039), 2].max()
    assert dent > 0.003
    on_cut = np.unique(cut.faces[cut.cut_faces])
    assert np.ptp(cut.vertices[-1][on_cut, 0]) > np.ptp(cut.vertices[0][on_cut, 0]) + 0.008


def test_same_seed_same_numbers_and_another_seed_another_motion(episodes):
    again = simulate_episode(COARSE, 0)
    np.testing.assert_array_equal(again.vertices, episodes[0].vertices)
    assert replace(COARSE, seed=1).motion_plan(0) != COARSE.motion_plan(0)
    assert COARSE.motion_plan(1) == replace(COARSE, episodes=9).motion_plan(1)


def test_effects_move_the_object_and_are_not_told(episodes):
    tilted = simulate_episode(COARSE, 0, [effect_type("tilt")(gx_m_s2=2.0)])
    moved = (tilted.vertices - episodes[0].vertices)[..., 0].mean()
    assert moved > 1e-4
    assert tilted.facts == episodes[0].facts and not tilted.truth


def test_an_object_that_relaxes_does_not_sink_on_after_the_first_frame():
    config, laws = EngineConfig(dx_m=COARSE.dx_m), [effect_type("relaxation")(ratio=0.8, tau_s=0.2)]
    rested = settled(whole_body(COARSE.shape, COARSE.spacing_m).particles, COARSE.material, config, laws)
    run = simulate(rested, COARSE.material, None, np.array([0, 0.4]), config, effects=laws)
    assert np.linalg.norm(run.positions[-1] - run.positions[0], axis=1).max() < 5e-5


def test_without_settling_the_object_starts_undeformed():
    sequence = simulate_episode(replace(COARSE, settle=False), 0)
    np.testing.assert_allclose(sequence.vertices[0], sequence.rest, atol=1e-7)


def test_shipped_scenes_can_be_read_and_use_another_law_than_the_engine(tmp_path, monkeypatch):
    assert shipped_scenes() == ["block.toml", "cylinder.toml", "quick-block.toml", "sphere.toml"]
    for name in shipped_scenes():
        scene = Scene.read(find_scene(Path(name)))
        assert scene.material.law == ElasticLaw.FIXED_COROTATED and scene.name == name.removesuffix(".toml")
        assert scene.spacing_m <= 0.004 and scene.dx_m == pytest.approx(2 * scene.spacing_m)
    monkeypatch.chdir(tmp_path)
    Path("block.toml").write_text('name = "mine"\n[shape]\nkind = "block"\nsize_m = [0.05, 0.04, 0.03]\n')
    assert Scene.read(find_scene(Path("block.toml"))).name == "mine", "a file in the current folder comes first"
    with pytest.raises(PlopError, match="Did you mean sphere.toml"):
        find_scene(Path("spere.toml"))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"shape": {"kind": "spere", "radius_m": 0.03}}, "Did you mean sphere"),
        ({"shape": {"kind": "block", "size_m": [80, 50, 40]}}, "write 0.08"),
        ({"shape": {"kind": "block"}}, "no size"),
        ({"shape": {"kind": "sphere", "size_m": [0.06, 0.06, 0.05]}}, "not those of a sphere"),
        ({"shape": "block"}, r"\[shape\] with keys"),
        ({"motions": ["pres"]}, "Did you mean press"),
        ({"motion": {"press_depth_m": [6, 11]}}, "press_depth_m"),
        ({"motion": {"hold_s": ["a", 1]}}, "wrong type"),
        ({"materal": {}}, "Did you mean material"),
        ({"material": {"young": 1e4}}, "Did you mean youngs_modulus_pa|Choose one of the keys"),
        ({"material": {"youngs_modulus_pa": -1}}, "youngs_modulus_pa"),
        ({"material": {"law": "fixed_corotate"}}, "Did you mean fixed_corotated"),
        ({"spacing_m": 4}, "spacing_m"),
        ({"spacing_m": "4"}, "wrong type"),
        ({"episodes": 0}, "episodes"),
        ({"episodes": "eight"}, "scene.episodes"),
        ({"shape": {"kind": "cone"}}, "block, cylinder, sphere|block, sphere, cylinder"),
        ({"shape": {"kind": "sphere", "radius_m": 0.03, "size_m": [0.06, 0.06, 0.06]}}, "two conflicting sizes"),
        ({"material": {"youngs_modulus_pa": 15}}, "youngs_modulus_pa"),
        ({"name": "../x"}, "name"),
    ],
)
def test_bad_scenes_are_refused_with_what_to_do(table, message):
    with pytest.raises(PlopError, match=message):
        Scene.from_dict(table)


def test_a_file_that_is_no_toml_is_named(tmp_path):
    (tmp_path / "bad.toml").write_text("name = [")
    with pytest.raises(PlopError, match="bad.toml"):
        Scene.read(tmp_path / "bad.toml")
    with pytest.raises(PlopError, match="Shipped scenes"):
        find_scene(tmp_path / "none.toml")


def test_a_motion_that_never_touches_is_refused():
    away = replace(COARSE, motions=("press",), motion=MotionRanges(press_depth_m=(-0.003, -0.003)))
    with pytest.raises(PlopError, match="never touches") as caught:
        simulate_episode(away, 0)
    assert "block_000 (press)" in str(caught.value.where)
    outside = replace(COARSE, motions=("cut",), motion=MotionRanges(cut_offset_m=(0.039, 0.039)))
    with pytest.raises(PlopError, match="cut is outside the object"):
        simulate_episode(outside, 0)


@pytest.mark.parametrize("change", [{"youngs_modulus_pa": 60.0}, {"density_kg_m3": 30000.0}])
def test_an_object_that_collapses_is_told_from_a_tool_that_misses_it(change):
    soft = replace(COARSE, motions=("press",), material=replace(COARSE.material, **change))
    with pytest.raises(PlopError, match="collapses under its own weight") as caught:
        simulate_episode(soft, 0)
    assert "mm high" in str(caught.value.found) and "[material]" in str(caught.value.fix)


def test_an_unstable_run_names_the_episode_and_the_parameter(monkeypatch):
    monkeypatch.setattr(scene_module, "EngineConfig", lambda dx_m: EngineConfig(dx_m=dx_m, dt_s=0.02))
    with pytest.raises(PlopError, match="unstable") as caught:
        simulate_episode(COARSE, 0)
    assert "block_000 (hold)" in str(caught.value.where) and "dt_s" in str(caught.value.where)
