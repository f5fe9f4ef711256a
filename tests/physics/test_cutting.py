"""The blade: it separates, pushes, and what it has separated stays apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.tools import blade_mesh
from tests.support.box import BOX_FACES

SIZE = (0.06, 0.03, 0.03)
SOFT = Material(youngs_modulus_pa=1.5e4, poisson=0.4, damping_per_s=5, tool_friction=0, table_friction=0.3)
CONFIG = EngineConfig(dx_m=0.01)


def motion(*points: tuple[float, float, float], times: list[float]) -> ToolMotion:
    """Lead the edge through points (x, y, z) at the given times."""
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    poses[:, :3, 3] = points
    return ToolMotion(*blade_mesh(), np.array(times), poses)


def test_cut_and_push_separate_the_halves(block):
    body = block(SIZE, 0.005)
    blade = motion((0, 0, 0.034), (0, 0, -0.005), (0.02, 0, -0.005), times=[0, 0.3, 0.6])
    run = simulate(body, SOFT, blade, np.linspace(0, 0.6, 13), CONFIG)
    right = body.positions[:, 0] > 0
    moved = (run.positions[-1] - body.positions)[:, 0]
    assert moved[right].mean() == pytest.approx(0.021, abs=0.002)
    assert abs(moved[~right].mean()) < 0.002
    near = np.abs(body.positions[:, 0]) < 0.02
    assert (run.sides[-1][near & right] == 1).all()
    assert (run.sides[-1][near & ~right] == -1).all()
    # the blade stands between them: nobody is inside it or beyond it
    assert run.positions[-1][right, 0].min() > 0.02
    assert run.positions[-1][~right, 0].max() < 0.002
    assert np.linalg.det(run.F[-1]).min() > 0.7
    assert run.tool_force[-1][0] > 0.05


def test_points_on_both_sides_of_the_cut_go_with_their_half(block):
    body = block(SIZE, 0.005)
    faces = np.array([[x, y, z] for x in (-1e-4, 1e-4) for y in (-0.01, 0, 0.01) for z in (0.001, 0.015, 0.0299)])
    both = Particles(np.concatenate([body.positions, faces]), np.append(body.volumes, np.zeros(len(faces))))
    blade = motion((0, 0, 0.034), (0, 0, -0.005), (0.02, 0, -0.005), times=[0, 0.3, 0.6])
    run = simulate(both, SOFT, blade, np.linspace(0, 0.6, 13), CONFIG)
    right, moved = faces[:, 0] > 0, (run.positions[-1, len(body) :] - faces)[:, 0]
    assert (run.sides[-1][len(body) :] == np.where(right, 1, -1)).all()
    assert moved[right].min() > 0.018 and np.abs(moved[~right]).max() < 0.002


def test_before_the_blade_arrives_the_block_is_one(block):
    body = block(SIZE, 0.005)
    run = simulate(body, SOFT, motion((0, 0, 0.034), (0, 0, 0.032), times=[0, 0.05]), np.array([0, 0.05]), CONFIG)
    assert (run.sides == 0).all()
    known = Particles(body.positions, body.volumes, sides=np.where(body.positions[:, 0] > 0, 1, -1))
    same = simulate(known, SOFT, motion((0, 0, 0.034), (0, 0, 0.032), times=[0, 0.05]), np.array([0, 0.05]), CONFIG)
    np.testing.assert_allclose(same.positions, run.positions, atol=2e-6)


def halves(block, speed: float, gap: float = 0.0) -> Particles:
    """Two halves that have been cut and move towards each other at twice `speed`."""
    body = block(SIZE, 0.005)
    sign = np.where(body.positions[:, 0] > 0, 1, -1)
    velocity = np.zeros_like(body.positions)
    velocity[:, 0] = -speed * sign
    return Particles(
        body.positions + 0.5 * gap * sign[:, None] * [1, 0, 0],
        body.volumes,
        velocity,
        sides=sign,
        passed=np.ones(len(sign), bool),
    )


def test_halves_push_each_other_without_merging(block):
    float_free = EngineConfig(dx_m=0.01, gravity_m_s2=(0, 0, 0), table_z_m=None)
    body = halves(block, 0.1)
    still = Material(youngs_modulus_pa=1.5e4, poisson=0.3, cut_friction=0)
    run = simulate(body, still, None, np.array([0, 0.05]), float_free)
    right = body.sides > 0
    assert run.positions[-1][right, 0].min() > run.positions[-1][~right, 0].max() - 0.002
    total = body.volumes @ run.final.velocities / body.volumes.sum()
    np.testing.assert_allclose(total, 0, atol=1e-5)
    # they bounced or stopped: neither half goes on through the other
    assert run.final.velocities[right, 0].mean() > -0.02
    apart = simulate(halves(block, -0.1), still, None, np.array([0, 0.1]), float_free)
    moved = (apart.positions[-1] - apart.positions[0])[:, 0]
    np.testing.assert_allclose(moved[right].mean(), 0.01, rtol=0.03)
    assert np.abs(apart.F[-1] - np.eye(3)).max() < 0.02


def test_whole_block_does_not_come_apart(block):
    body = halves(block, -0.02)
    whole = Particles(body.positions, body.volumes, body.velocities, sides=body.sides)
    run = simulate(
        whole, SOFT, None, np.array([0, 0.2]), EngineConfig(dx_m=0.01, gravity_m_s2=(0, 0, 0), table_z_m=None)
    )
    assert np.abs(run.positions[-1] - run.positions[0]).max() < 0.003


def test_toughness_costs_its_energy(block):
    body = block(SIZE, 0.005)
    blade = motion((0, 0, 0.034), (0, 0, 0.002), times=[0, 0.4])
    times = np.array([0, 0.15, 0.35, 0.4])
    material = Material(youngs_modulus_pa=1.5e4, tool_friction=0, damping_per_s=20)
    tough = replace(material, toughness_j_m2=10.0)
    forces = [simulate(body, m, blade, times, CONFIG).tool_force[2, 2] for m in (material, tough)]
    # [J/m^2] times the width of the block [m] is the force along the way of the edge [N]
    assert forces[0] - forces[1] == pytest.approx(10 * SIZE[1], rel=0.2)


def test_blade_does_not_touch_across_a_gap(block):
    body = block(SIZE, 0.005)
    beside = motion((0.034, 0, -0.005), (0.0335, 0, -0.005), times=[0, 0.1])
    run = simulate(body, SOFT, beside, np.array([0, 0.05, 0.1]), CONFIG)
    assert np.abs(run.tool_force).max() < 1e-6


def test_solid_plate_presses(block):
    body = block((0.03, 0.03, 0.03), 0.0025)
    low, high = np.array([-0.03, -0.03, 0.0]), np.array([0.03, 0.03, 0.03])
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    hull_faces = BOX_FACES
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 2, 3] = [0.0302, 0.0285, 0.0285]
    plate = ToolMotion(corners, hull_faces, np.array([0, 0.2, 0.5]), poses)
    material = Material(youngs_modulus_pa=2e4, poisson=0.2, table_friction=0, tool_friction=0, damping_per_s=40)
    run = simulate(body, material, plate, np.array([0, 0.25, 0.3]), EngineConfig(dx_m=0.005, gravity_m_s2=(0, 0, 0)))
    # 5 % of compression; the linear law and the contact's place are good to some per cent
    assert -run.tool_force[-1][2] == pytest.approx(2e4 * 0.05 * 0.03**2, rel=0.12)
    assert run.table_force[-1][2] == pytest.approx(-run.tool_force[-1][2], rel=0.03)
