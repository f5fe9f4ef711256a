"""Effects at table, tool and edge against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from plop.physics.effects.adhesion import Adhesion
from plop.physics.effects.blade_friction import BladeFriction
from plop.physics.effects.table_friction import TableFriction
from plop.physics.effects.tilt import Tilt
from plop.physics.effects.toughness import Toughness
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.demo import blade_mesh

G = 9.81
CONFIG = EngineConfig(dx_m=0.01)


def test_table_friction_sets_the_stopping_way(block):
    body = block((0.04, 0.04, 0.02), 0.005)
    sliding = Particles(body.positions, body.volumes, np.tile([0.5, 0, 0], (len(body), 1)))
    material = Material(youngs_modulus_pa=1e5, poisson=0.3, table_friction=0.2)
    run = simulate(sliding, material, None, np.array([0, 0.08, 0.4]), CONFIG, effects=[TableFriction(d_mu=0.2)])
    way = (run.positions - run.positions[0]).mean(1)[:, 0]
    assert way[1] == pytest.approx(0.5 * 0.08 - 0.5 * 0.4 * G * 0.08**2, rel=0.03)
    assert way[2] == pytest.approx(0.5**2 / (2 * 0.4 * G), rel=0.06)


def test_friction_and_toughness_do_not_fall_below_zero():
    base = Material(table_friction=0.3, tool_friction=0.3, toughness_j_m2=2)
    assert TableFriction(d_mu=-1).material(base).table_friction == 0
    assert BladeFriction(d_mu=-1).material(base).tool_friction == 0
    assert Toughness(d_j_m2=-5).material(base).toughness_j_m2 == 0
    assert TableFriction(d_mu=-0.1).material(base).table_friction == pytest.approx(0.2)


def test_blade_friction_is_the_ratio_of_the_tool_s_forces(block, plate):
    body = block((0.03, 0.03, 0.03), 0.005)
    motion = plate((0, 0.0302), (0, 0.0285), (0, 0.0285), (0.01, 0.0285), times=[0, 0.1, 0.12, 0.22])
    material = Material(youngs_modulus_pa=2e4, poisson=0.2, table_friction=5, tool_friction=0.1, damping_per_s=40)
    run = simulate(body, material, motion, np.array([0, 0.18, 0.22]), CONFIG, effects=[BladeFriction(d_mu=0.2)])
    force = run.tool_force[-1]
    assert force[0] == pytest.approx(-0.3 * force[2], rel=0.05)
    assert force[2] < -0.3


def test_adhesion_pulls_with_its_traction_and_then_lets_go(block, plate):
    body = block((0.03, 0.03, 0.03), 0.005)
    motion = plate((0, 0.0305), (0, 0.0298), (0, 0.0325), times=[0, 0.05, 0.15])
    material = Material(youngs_modulus_pa=2e4, poisson=0.2, damping_per_s=20)
    times = np.array([0, 0.05, 0.13, 0.15, 0.31, 0.32])
    sticky = simulate(body, material, motion, times, CONFIG, effects=[Adhesion(traction_pa=150, release_s=2.0)])
    # the object is too heavy to be lifted; the bond has the top's area and no time to fade
    assert sticky.tool_force[3, 2] == pytest.approx(150 * 0.03**2, rel=0.1)
    assert sticky.table_force[3, 2] == pytest.approx((1000 * G * 0.03 - 150) * 0.03**2, rel=0.15)
    fading = simulate(body, material, motion, times, CONFIG, effects=[Adhesion(traction_pa=150, release_s=0.03)])
    assert 0 < fading.tool_force[3, 2] < 0.7 * sticky.tool_force[3, 2]
    assert fading.tool_force[5, 2] == 0
    plain = simulate(body, material, motion, times, CONFIG)
    assert plain.tool_force[3, 2] == 0


def test_adhesion_lifts_what_is_light_enough(block, plate):
    body = block((0.03, 0.03, 0.03), 0.005)
    motion = plate((0, 0.0305), (0, 0.0298), (0, 0.0398), times=[0, 0.05, 0.25])
    run = simulate(
        body,
        Material(youngs_modulus_pa=2e4, poisson=0.2),
        motion,
        np.array([0, 0.25]),
        CONFIG,
        effects=[Adhesion(traction_pa=900, release_s=2.0)],
    )
    assert (run.positions[-1] - run.positions[0])[:, 2].min() > 0.007


def test_toughness_costs_force_times_width(block):
    body = block((0.06, 0.03, 0.03), 0.005)
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, 2, 3] = [0.034, 0.002]
    blade = ToolMotion(*blade_mesh(), np.array([0, 0.4]), poses)
    material = Material(youngs_modulus_pa=1.5e4, tool_friction=0, damping_per_s=20)
    forces = [
        simulate(body, material, blade, np.array([0, 0.15, 0.35]), CONFIG, effects=e).tool_force[2, 2]
        for e in ([], [Toughness(d_j_m2=10.0)])
    ]
    assert forces[0] - forces[1] == pytest.approx(10 * 0.03, rel=0.2)


def test_tilt_is_a_sideways_fall(block):
    body = block((0.02, 0.02, 0.02), 0.005)
    run = simulate(
        body,
        Material(),
        None,
        np.array([0, 0.1]),
        EngineConfig(dx_m=0.01, table_z_m=None),
        effects=[Tilt(gx_m_s2=0.5, gy_m_s2=-1.0)],
    )
    fallen = (run.positions[-1] - run.positions[0]).mean(0)
    np.testing.assert_allclose(fallen, 0.5 * 0.1**2 * np.array([0.5, -1.0, -G]), rtol=0.02)
