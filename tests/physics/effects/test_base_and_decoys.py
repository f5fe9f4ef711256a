"""Base parameters and decoys against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from plop.physics.effects.damping import Damping
from plop.physics.effects.density import Density
from plop.physics.effects.drag import Drag
from plop.physics.effects.inertia import Inertia
from plop.physics.effects.stiffness import Stiffness
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate


@pytest.fixture(scope="module")
def flying_speed(block):
    """Speed of a free body that starts with 1 m/s, at the given times [s]."""
    body = block((0.02, 0.02, 0.02), 0.005)
    moving = Particles(body.positions, body.volumes, np.tile([0.6, 0, 0.8], (len(body), 1)))

    def measure(effect, times) -> np.ndarray:
        config = EngineConfig(dx_m=0.01, gravity_m_s2=(0, 0, 0), table_z_m=None)
        ends = [
            simulate(moving, Material(damping_per_s=2), None, np.array([0, t]), config, effects=[effect]).final
            for t in times
        ]
        return np.array([np.linalg.norm(end.velocities, axis=1).mean() for end in ends])

    return measure


@pytest.mark.parametrize(
    ("effect", "ratio"),
    [
        (Stiffness(d_ln_e=np.log(2)), np.sqrt(0.5)),
        (Stiffness(d_ln_e=-np.log(1.5)), np.sqrt(1.5)),
        (Density(d_ln_rho=np.log(2)), np.sqrt(2)),
        (Inertia(ratio=0.5), np.sqrt(1.5)),
    ],
)
def test_period_of_a_bar(half_period_s, effect, ratio):
    assert half_period_s(effect) / half_period_s() == pytest.approx(ratio, rel=0.02)


def test_inertia_does_not_weigh_and_density_does(block):
    body = block((0.03, 0.03, 0.03), 0.005)
    material = Material(youngs_modulus_pa=2e4, damping_per_s=60)
    weight = 9.81 * 1000 * 0.03**3
    for effect, factor in [(Inertia(ratio=1.0), 1), (Density(d_ln_rho=np.log(2)), 2)]:
        run = simulate(body, material, None, np.array([0, 0.2, 0.25]), EngineConfig(dx_m=0.01), effects=[effect])
        assert run.table_force[-1, 2] == pytest.approx(factor * weight, rel=0.02)


def test_damping_adds_to_the_base_s(flying_speed):
    np.testing.assert_allclose(flying_speed(Damping(d_per_s=18), [0.05]), np.exp(-1), rtol=0.01)
    np.testing.assert_allclose(flying_speed(Damping(d_per_s=-50), [0.05]), 1, rtol=1e-3)


def test_drag_is_quadratic(flying_speed):
    """With v' = -a v - c v^2 the speed is a / ((a / v0 + c) exp(a t) - c)."""
    times = np.array([0.02, 0.1])
    np.testing.assert_allclose(flying_speed(Drag(per_m=30.0), times), 2 / (32 * np.exp(2 * times) - 30), rtol=0.01)
