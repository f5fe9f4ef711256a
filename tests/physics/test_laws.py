"""The engine against laws that have a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import ElasticLaw, Material
from plop.physics.engine.solver import simulate

G = 9.81


def momentum(particles, material):
    return (particles.volumes * material.density_kg_m3) @ particles.velocities


def test_free_fall(block):
    body = block((0.03, 0.03, 0.03), 0.005, bottom_m=0.5)
    run = simulate(body, Material(), None, np.array([0, 0.1, 0.2]), EngineConfig(dx_m=0.01))
    fallen = run.positions.mean(1)[:, 2] - run.positions[0].mean(0)[2]
    np.testing.assert_allclose(fallen[1:], -0.5 * G * np.array([0.1, 0.2]) ** 2, rtol=0.02)
    assert np.abs(run.F - np.eye(3)).max() < 1e-3


@pytest.mark.parametrize("law", list(ElasticLaw))
def test_momentum_and_spin_are_kept_without_contact(block, law):
    body = block((0.04, 0.03, 0.03), 0.005)
    arm = body.positions - body.positions.mean(0)
    spinning = np.cross([0.0, 0.0, 8.0], arm) + [0.3, -0.1, 0.2] + 6 * arm * [1, -1, 0]
    material = Material(youngs_modulus_pa=2e4, law=law)
    run = simulate(
        type(body)(body.positions, body.volumes, spinning),
        material,
        None,
        np.array([0, 0.03, 0.06]),
        EngineConfig(dx_m=0.01, gravity_m_s2=(0, 0, 0), table_z_m=None),
    )
    mass = body.volumes * material.density_kg_m3
    before, after = mass @ spinning, momentum(run.final, material)
    np.testing.assert_allclose(after, before, atol=2e-5 * np.abs(before).max())
    end = run.final
    arm_after = end.positions - end.positions.mean(0)
    # the affine field carries dx^2/4 times its antisymmetric part per unit mass
    local = 0.01**2 / 4 * (end.affine[:, 1, 0] - end.affine[:, 0, 1])
    spin_after = mass @ (np.cross(arm_after, end.velocities)[:, 2] + local)
    assert spin_after == pytest.approx(mass @ np.cross(arm, spinning)[:, 2], rel=2e-3)


def test_momentum_balance_with_table(block):
    body = block((0.04, 0.04, 0.03), 0.005, bottom_m=0.002)
    material = Material(youngs_modulus_pa=2e4, damping_per_s=0)
    body = type(body)(body.positions, body.volumes, np.tile([0.2, 0.0, -0.1], (len(body), 1)))
    run = simulate(body, material, None, np.linspace(0, 0.08, 5), EngineConfig(dx_m=0.01))
    mass = body.volumes.sum() * material.density_kg_m3
    weight = np.array([0, 0, -G * mass])
    change = momentum(run.final, material) - mass * np.array([0.2, 0, -0.1])
    np.testing.assert_allclose(change, 0.02 * (run.table_force[1:] + weight).sum(0), atol=2e-4 * mass)
    assert run.table_force[-1][2] > 0.2 * G * mass


def test_resting_column_sags_as_the_bar_under_its_own_weight(block):
    height, young = 0.06, 6e3
    body = block((0.03, 0.03, height), 0.005)
    material = Material(youngs_modulus_pa=young, poisson=0.3, table_friction=0, damping_per_s=40)
    run = simulate(body, material, None, np.array([0, 0.4, 0.45]), EngineConfig(dx_m=0.01))
    z = body.positions[:, 2]
    expected = -material.density_kg_m3 * G / young * (height * z - z**2 / 2)
    sag = run.positions[-1, :, 2] - z
    assert np.sqrt(np.mean((sag - expected) ** 2)) < 0.05 * np.abs(expected).max()
    assert run.table_force[-1][2] == pytest.approx(body.volumes.sum() * material.density_kg_m3 * G, rel=0.01)


@pytest.mark.parametrize(("cone", "share"), [("round", 1.0), ("pyramid", np.sqrt(2))])
def test_sliding_block_obeys_coulomb(block, cone, share):
    friction, speed = 0.3, 0.5
    body = block((0.04, 0.04, 0.02), 0.005)
    diagonal = speed * np.array([1, 1, 0]) / np.sqrt(2)
    material = Material(youngs_modulus_pa=1e5, poisson=0.3, table_friction=friction, damping_per_s=0)
    run = simulate(
        type(body)(body.positions, body.volumes, np.tile(diagonal, (len(body), 1))),
        material,
        None,
        np.array([0, 0.08, 0.4]),
        EngineConfig(dx_m=0.01, table_cone=cone),
    )
    way = np.linalg.norm((run.positions - run.positions[0]).mean(1)[:, :2], axis=1)
    brake = share * friction * G
    assert way[1] == pytest.approx(speed * 0.08 - 0.5 * brake * 0.08**2, rel=0.03)
    assert way[2] == pytest.approx(speed**2 / (2 * brake), rel=0.06)


@pytest.mark.parametrize("cone", ["round", "pyramid"])
def test_slow_sliding_decays_with_the_slip_speed_and_fast_sliding_obeys_coulomb(block, cone):
    friction, slip, speed = 0.3, 1.0, 0.5
    body = block((0.04, 0.04, 0.02), 0.005)
    material = Material(youngs_modulus_pa=1e5, poisson=0.3, table_friction=friction, table_slip_m_s=slip)
    along = np.tile([speed, 0, 0], (len(body), 1))
    slow = friction * slip
    turn = (speed - slow) / (friction * G)
    run = simulate(
        type(body)(body.positions, body.volumes, along),
        material,
        None,
        np.array([0, turn, turn + 0.1]),
        EngineConfig(dx_m=0.01, table_cone=cone),
    )
    way = (run.positions - run.positions[0]).mean(1)[:, 0]
    assert way[1] == pytest.approx((speed**2 - slow**2) / (2 * friction * G), rel=0.03)
    assert way[2] - way[1] == pytest.approx(slow * slip / G * (1 - np.exp(-0.1 * G / slip)), rel=0.03)


def bar_frequency_error(block, spacing, law=ElasticLaw.NEO_HOOKEAN):
    """Relative error of a free bar's first longitudinal mode against sqrt(E / density) / (2 L)."""
    length, young = 0.12, 2e4
    body = block((length, 2 * 0.01, 2 * 0.01), spacing)
    mode = np.sin(np.pi * body.positions[:, 0] / length)
    velocity = np.zeros((len(body), 3))
    velocity[:, 0] = 0.02 * mode
    material = Material(youngs_modulus_pa=young, poisson=0.0, law=law)
    times = np.linspace(0, 0.075, 61)
    run = simulate(
        type(body)(body.positions, body.volumes, velocity),
        material,
        None,
        times,
        EngineConfig(dx_m=2 * spacing, gravity_m_s2=(0, 0, 0), table_z_m=None, courant=0.3),
    )
    stretch = ((run.positions - run.positions[0])[:, :, 0] * mode).mean(1)
    falls = np.nonzero((stretch[1:-1] > 0) & (stretch[2:] <= 0))[0][0] + 1
    half_period = times[falls] + (times[1] - times[0]) * stretch[falls] / (stretch[falls] - stretch[falls + 1])
    expected = length / np.sqrt(young / material.density_kg_m3)
    return abs(half_period / expected - 1)


def test_oscillating_bar_and_refinement(block):
    coarse, fine = (bar_frequency_error(block, spacing) for spacing in (0.01, 0.005))
    assert fine < 0.03
    assert fine < 0.7 * coarse


def test_second_law_oscillates_alike(block):
    assert bar_frequency_error(block, 0.0075, ElasticLaw.FIXED_COROTATED) < 0.05


def test_damping_slows_a_free_body_exponentially(block):
    body = block((0.02, 0.02, 0.02), 0.005)
    body = type(body)(body.positions, body.volumes, np.tile([1.0, 0, 0], (len(body), 1)))
    run = simulate(
        body,
        Material(damping_per_s=20),
        None,
        np.array([0, 0.05]),
        EngineConfig(dx_m=0.01, gravity_m_s2=(0, 0, 0), table_z_m=None),
    )
    np.testing.assert_allclose(run.final.velocities[:, 0], np.exp(-1), rtol=0.01)
