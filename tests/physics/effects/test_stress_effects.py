"""Effects that add stress against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from plop.physics.effects.fibres import Fibres
from plop.physics.effects.relaxation import Relaxation
from plop.physics.effects.softening import Softening
from plop.physics.effects.stiffening import Stiffening
from plop.physics.effects.viscosity import Viscosity
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import ElasticLaw, Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate

MATERIAL = Material(youngs_modulus_pa=3e4, poisson=0.4)
MU = MATERIAL.shear_pa


def stretched(*stretches: float) -> np.ndarray:
    """Isochoric stretches along x, as deformation gradients [N, 3, 3]."""
    return np.stack([np.diag([s, s**-0.5, s**-0.5]) for s in stretches])


def stress_of(engine, effect) -> np.ndarray:
    engine.extra[:] = 0
    effect.stress(engine, 1e-4)
    return engine.extra.astype(float)


def strain_along(engine, effect, rate: np.ndarray, seconds: float, steps: int) -> None:
    """Move the particles with the velocity gradient `rate` [3, 3] [1/s] as the engine would."""
    dt = seconds / steps
    engine.c[:] = rate
    for _ in range(steps):
        engine.f[:] = (np.eye(3) + dt * rate).astype(np.float32) @ engine.f
        effect.after(engine, dt)


def test_viscosity_damps_a_bar(block):
    """A free bar's mode k loses (4/3 eta) k^2 / (2 density) of its amplitude a second, beyond what it loses anyway."""
    body, eta, wave = block((0.12, 0.02, 0.02), 0.005), 24.0, np.pi / 0.12
    mode = np.sin(wave * body.positions[:, 0])
    moving = Particles(body.positions, body.volumes, 0.02 * mode[:, None] * [1, 0, 0])
    material, seconds = Material(youngs_modulus_pa=2e4, poisson=0.0), 0.12 / np.sqrt(20)
    config = EngineConfig(dx_m=0.01, gravity_m_s2=(0, 0, 0), table_z_m=None, dt_s=3e-4)
    left = [
        simulate(moving, material, None, np.array([0, seconds]), config, effects=e).final.velocities[:, 0] @ mode
        for e in ([], [Viscosity(viscosity_pa_s=eta)])
    ]
    assert np.log(left[0] / left[1]) == pytest.approx(4 / 3 * eta * wave**2 / 2000 * seconds, rel=0.1)


def test_fibres_stiffen_a_bar_along_and_not_across(half_period_s):
    plain = half_period_s()
    assert plain / half_period_s(Fibres(ratio=3.0)) == pytest.approx(2, rel=0.02)
    assert plain / half_period_s(Fibres(ratio=3.0, angle_deg=90)) == pytest.approx(1, rel=0.005)


def test_fibres_lie_where_the_angle_points(strained):
    small = 1e-3
    f = np.eye(3) + small * np.outer([0, 1, 0], [0, 1, 0])
    for angle, share in [(0, 0.0), (45, 0.25), (90, 1.0), (-45, 0.25)]:
        effect = Fibres(ratio=2.0, angle_deg=angle)
        stress = stress_of(strained(f[None], [effect], MATERIAL), effect)[0]
        assert stress[1] == pytest.approx(2 * 3e4 * small * share, rel=0.01, abs=1e-3)
        assert stress[2] == stress[4] == stress[5] == 0


def test_stiffening_is_yeoh_s_second_term(strained):
    effect, s = Stiffening(growth=8.0), np.array([0.7, 1.0, 1.05, 1.4])
    stress = stress_of(strained(stretched(*s), [effect], MATERIAL), effect)
    strain = s**2 + 2 / s - 3
    np.testing.assert_allclose(stress[:, 0] - stress[:, 1], MU * 8 * strain * (s**2 - 1 / s), rtol=2e-3, atol=0.02)
    np.testing.assert_allclose(stress[:, :3].sum(1), 0, atol=0.05)
    swollen = stress_of(strained(1.1 * stretched(*s), [effect], MATERIAL), effect)
    np.testing.assert_allclose(swollen, stress, rtol=2e-3, atol=0.05)


def test_relaxation_fades_as_maxwell_under_held_strain(strained):
    tau, ratio = 0.2, 0.4
    effect = Relaxation(ratio=ratio, tau_s=tau)
    engine = strained(stretched(1.0), [effect], MATERIAL)
    strain_along(engine, effect, np.diag([40.0, -20.0, -20.0]), 0.005, 50)
    b = np.diag(engine.f[0].astype(float)) ** 2
    full = -ratio * MU * (b[0] - b[1])
    sudden = stress_of(engine, effect)[0]
    assert abs(sudden[0] - sudden[1]) < 0.02 * abs(full)
    lost = []
    for _ in range(3):
        strain_along(engine, effect, np.zeros((3, 3)), tau, 100)
        stress = stress_of(engine, effect)[0]
        lost.append((stress[0] - stress[1]) / full)
    np.testing.assert_allclose(lost, 1 - np.exp([-1.0, -2.0, -3.0]), atol=0.01)


def test_relaxation_does_not_mind_being_turned(strained):
    """A branch that never relaxes carries the base's stress through any motion."""
    effect = Relaxation(ratio=0.5, tau_s=100.0)
    engine = strained(stretched(1.0), [effect], MATERIAL)
    strain_along(engine, effect, np.array([[10.0, 4, 0], [2, -5, 3], [0, 1, -5]]), 0.02, 100)
    strain_along(engine, effect, np.array([[0.0, -60, 0], [60, 0, 20], [0, -20, 0]]), 0.02, 100)
    assert np.abs(engine.f - np.eye(3)).max() > 0.5
    assert np.abs(stress_of(engine, effect)).max() < 2e-3 * MU


@pytest.mark.parametrize("law", list(ElasticLaw))
def test_softening_lets_the_first_loading_be_and_weakens_the_second(strained, law):
    effect = Softening(loss=0.6, strain=0.3)
    material = Material(youngs_modulus_pa=3e4, poisson=0.4, law=law)
    engine = strained(stretched(1.3), [effect], material)
    assert np.abs(stress_of(engine, effect)).max() < 1e-3
    engine.f[:] = stretched(1.1)
    second = stress_of(engine, effect)[0]
    peak, strain = (s**2 + 2 / s - 3 for s in (1.3, 1.1))
    share = 0.6 * (1 - np.exp(-(peak - strain) / (3 * 0.3**2)))
    first = {
        0: MU * (1.1**2 - 1 / 1.1),
        1: 2 * MU * (1.1 * 0.1 - 1.1**-0.5 * (1.1**-0.5 - 1)),
        2: MU * (1 - 1 / (strain + 4)) * (1.1**2 - 1 / 1.1),
    }[int(law)]
    assert second[0] - second[1] == pytest.approx(-share * first, rel=2e-3)
    engine.f[:] = stretched(1.3)
    assert np.abs(stress_of(engine, effect)).max() < 1e-3
