"""The engine as a program: determinism, stability, continuing, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from plop.errors import PlopError
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.engine import Engine, UnstableStepError
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.physics.engine.time_step import LEAST_STEP_S

TIMES = np.array([0, 0.02, 0.04])


def test_threads_and_chunks_do_not_change_the_result(block):
    body = block((0.04, 0.03, 0.03), 0.005)
    runs = [simulate(body, Material(), None, TIMES, EngineConfig(dx_m=0.01, threads=t)).positions for t in (1, 2, 1)]
    assert (runs[0] == runs[1]).all() and (runs[0] == runs[2]).all()
    chunked = simulate(body, Material(), None, TIMES, EngineConfig(dx_m=0.01, chunks=1)).positions
    np.testing.assert_allclose(chunked, runs[0], atol=1e-6)


def test_order_of_particles_and_place_of_the_object_do_not_matter(block):
    body = block((0.04, 0.03, 0.03), 0.005)
    shuffle = np.random.default_rng(0).permutation(len(body))
    plain = simulate(body, Material(), None, TIMES, EngineConfig(dx_m=0.01))
    mixed = simulate(
        Particles(body.positions[shuffle], body.volumes[shuffle]), Material(), None, TIMES, EngineConfig(dx_m=0.01)
    )
    np.testing.assert_allclose(mixed.positions, plain.positions[:, shuffle], atol=1e-6)
    shift = np.array([0.07, -0.23, 0.4])
    moved = simulate(
        Particles(body.positions + shift, body.volumes), Material(), None, TIMES, EngineConfig(dx_m=0.01, table_z_m=0.4)
    )
    np.testing.assert_allclose(moved.positions - shift, plain.positions, atol=2e-6)


def test_a_run_can_go_on(block):
    body = block((0.04, 0.03, 0.03), 0.005, bottom_m=0.01)
    config = EngineConfig(dx_m=0.01)
    whole = simulate(body, Material(), None, TIMES, config)
    half = simulate(body, Material(), None, TIMES[:2], config)
    rest = simulate(half.final, Material(), None, TIMES[1:], config)
    # the second run starts with another speed and so with another time step
    np.testing.assert_allclose(rest.positions[-1], whole.positions[-1], atol=1e-5)


def test_tracers_follow_and_do_not_act(block):
    body = block((0.04, 0.03, 0.03), 0.005)
    extra = np.array([[0.0, 0.0, 0.03], [0.01, 0.002, 0.012]])
    with_tracers = Particles(
        np.concatenate([extra[:1], body.positions, extra[1:]]), np.concatenate([[0], body.volumes, [0]])
    )
    plain = simulate(body, Material(), None, TIMES, EngineConfig(dx_m=0.01))
    run = simulate(with_tracers, Material(), None, TIMES, EngineConfig(dx_m=0.01))
    np.testing.assert_array_equal(run.positions[:, 1:-1], plain.positions)
    np.testing.assert_array_equal(run.F[:, 1:-1], plain.F)
    near = np.linalg.norm(body.positions - extra[1], axis=1).argsort()[:4]
    assert (
        np.linalg.norm((run.positions[-1, -1] - extra[1]) - (plain.positions[-1] - body.positions)[near].mean(0)) < 2e-4
    )


def test_tracers_at_the_corners_turn_with_the_body(block):
    body = block((0.04, 0.03, 0.03), 0.005)
    corners = np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.015, 0.015) for z in (0, 0.03)])
    positions = np.concatenate([body.positions, corners])
    spin = np.cross([0, 0, 10.0], positions)
    both = Particles(positions, np.concatenate([body.volumes, np.zeros(8)]), spin)
    config = EngineConfig(dx_m=0.01, gravity_m_s2=(0, 0, 0), table_z_m=None)
    run = simulate(both, Material(), None, np.linspace(0, 0.05, 6), config)
    inner, outer = run.positions[-1, :-8], run.positions[-1, -8:]
    # the affine motion of the body, carried on to its corners
    design = np.concatenate([body.positions, np.ones((len(body), 1))], 1)
    affine = np.linalg.lstsq(design, inner, rcond=None)[0]
    expected = np.concatenate([corners, np.ones((8, 1))], 1) @ affine
    way = np.linalg.norm(expected - corners, axis=1).min()
    assert way > 5e-3
    assert np.linalg.norm(outer - expected, axis=1).max() < 0.03 * way


def test_too_long_a_step_names_the_parameter_and_gives_no_nan(block):
    body = block((0.04, 0.03, 0.03), 0.005)
    stiff = Material(youngs_modulus_pa=1e6)
    with pytest.raises(PlopError, match="unstable") as caught:
        simulate(body, stiff, None, np.array([0, 0.2]), EngineConfig(dx_m=0.01, dt_s=2e-3))
    assert "dt_s" in str(caught.value.where)


@pytest.mark.parametrize(("name", "value"), [("viscosity_pa_s", 9e4), ("youngs_modulus_pa", 1e10)])
def test_endless_time_steps_are_refused_with_the_value_that_would_do(block, name, value):
    body, config = block((0.04, 0.03, 0.03), 0.005), EngineConfig(dx_m=0.01)
    with pytest.raises(PlopError, match="too many time steps") as caught:
        simulate(body, Material(**{name: value}), None, TIMES, config)
    assert str(caught.value.where) == f"{name} = {value:g}" and "for each second" in str(caught.value.found)
    most = float(str(caught.value.fix).partition("up to ")[2].split()[0])
    assert Engine(body, Material(**{name: 0.9 * most}), None, config).longest_step_s >= LEAST_STEP_S
    assert most < value


def test_an_unstable_frame_is_repeated_with_half_the_step(block, monkeypatch):
    body, check, longest = block((0.04, 0.03, 0.03), 0.005), Engine._check, []

    def refuse_long_steps(engine, fastest, smallest, dt):
        longest.append(dt)
        if dt > 4e-4:
            raise UnstableStepError("a step that this test calls too long")
        check(engine, fastest, smallest, dt)

    plain = simulate(body, Material(), None, TIMES, EngineConfig(dx_m=0.01))
    assert plain.dt_s > 8e-4
    monkeypatch.setattr(Engine, "_check", refuse_long_steps)
    run = simulate(body, Material(), None, TIMES, EngineConfig(dx_m=0.01))
    assert run.halvings == 2 and run.steps == len(longest)
    quarter = simulate(body, Material(), None, TIMES, EngineConfig(dx_m=0.01, courant=0.1))
    np.testing.assert_allclose(run.positions, quarter.positions, atol=1e-6)
    with pytest.raises(PlopError, match="unstable") as caught:
        simulate(body, Material(), None, TIMES, EngineConfig(dx_m=0.01, max_halvings=1))
    assert "youngs_modulus_pa" in str(caught.value.where)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("youngs_modulus_pa", -1.0),
        ("poisson", 0.5),
        ("density_kg_m3", np.nan),
        ("table_friction", -0.1),
        ("toughness_j_m2", np.inf),
    ],
)
def test_material_out_of_range(name, value):
    with pytest.raises(PlopError, match="out of range|not finite") as caught:
        Material(**{name: value})
    assert caught.value.where == f"Material.{name}" and caught.value.expected


def test_bad_particles_and_times(block):
    with pytest.raises(PlopError, match="too large"):
        Particles(np.random.default_rng(0).uniform(0, 80.0, (10, 3)), np.full(10, 1.0))
    with pytest.raises(PlopError, match="cannot be used"):
        Particles(np.zeros((4, 3)), np.zeros(4))
    with pytest.raises(PlopError, match="cannot be used"):
        Particles(np.zeros((4, 3)), np.ones(4), velocities=np.full((4, 3), np.nan))
    with pytest.raises(PlopError, match="times"):
        simulate(block((0.02, 0.02, 0.02), 0.005), Material(), None, np.array([0.0, 0.0]))
    with pytest.raises(PlopError, match="setting"):
        EngineConfig(dx_m=-1)
