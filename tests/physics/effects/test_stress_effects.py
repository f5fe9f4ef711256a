"""Effects that add stress against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from plop.physics.effects.fibres import Fibres
from plop.physics.effects.relaxation import Relaxation
from plop.physics.effects.softening import Softening
from plop.physics.effects.stiffening import Stiffening
from plop.physics.effects.uneven import Crust, Graded, Layered
from plop.physics.effects.viscosity import Viscosity
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.engine import Engine
from plop.physics.engine.material import ElasticLaw, Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate

MATERIAL = Material(youngs_modulus_pa=3e4, poisson=0.4)
MU = MATERIAL.shear_pa
FREE = EngineConfig(gravity_m_s2=(0, 0, 0), table_z_m=None)


def stretched(*stretches: float) -> np.ndarray:
    """Isochoric stretches along x, as deformation gradients [N, 3, 3]."""
    return np.stack([np.diag([s, s**-0.5, s**-0.5]) for s in stretches])


def stress_of(engine, effect) -> np.ndarray:
    engine.extra[:] = 0
    effect.stress(engine, 1e-4)
    return engine.extra.astype(float)


def kirchhoff_zz(f: np.ndarray) -> float:
    """The default law's stress along z, neo-Hookean [Pa]."""
    e, nu = MATERIAL.youngs_modulus_pa, MATERIAL.poisson
    lam = e * nu / ((1 + nu) * (1 - 2 * nu))
    return float(MU * (f[2, 2] ** 2 - 1) + lam * np.log(np.linalg.det(f)))


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


@pytest.mark.parametrize(
    ("effect", "axis"), [(Graded(ln_e_x=0.5), 0), (Graded(ln_e_y=-0.5), 1), (Layered(ln_e=0.5), 2)]
)
def test_a_modulus_grows_evenly_from_one_end_to_the_other(block, effect, axis):
    body = block((0.06, 0.05, 0.04), 0.005)
    squeezed = np.tile(np.diag([1.0, 1.0, 0.99]), (len(body.positions), 1, 1))
    engine = Engine(Particles(body.positions, body.volumes, F=squeezed), MATERIAL, None, FREE, [effect])
    engine.extra = np.zeros((len(squeezed), 6), np.float32)
    base = kirchhoff_zz(squeezed[0])
    ratio = 1 + stress_of(engine, effect)[:, 2] / base
    place = engine.x[:, axis].astype(float)
    place = 2 * (place - place.min()) / np.ptp(place) - 1
    np.testing.assert_allclose(np.log(ratio), effect.values[effect.amplitudes[axis % 2].name] * place, atol=2e-3)


@pytest.mark.parametrize("spread", [0.0, 0.3])
def test_a_crust_is_where_the_surface_is(block, spread):
    """On a lattice and on particles that are drawn; the base's modulus is the geometric mean."""
    body, effect = block((0.06, 0.05, 0.04), 0.004), Crust(ln_e=0.5)
    places = body.positions + np.random.default_rng(0).uniform(-spread, spread, body.positions.shape) * 0.004
    f = np.tile(np.diag([1.0, 1.0, 0.99]), (len(places), 1, 1))
    engine = Engine(Particles(places, body.volumes, F=f), MATERIAL, None, FREE, [effect])
    engine.extra = np.zeros((len(f), 6), np.float32)
    log = np.log(1 + stress_of(engine, effect)[:, 2] / kirchhoff_zz(f[0]))
    low, high = body.positions.min(0) - 0.002, body.positions.max(0) + 0.002
    depth = np.minimum(engine.x - low, high - engine.x).min(1)
    assert np.corrcoef(log, depth)[0, 1] < -0.95
    assert log.mean() == pytest.approx(0, abs=2e-3)
    assert log[depth < 0.003].mean() - log[depth > 0.016].mean() == pytest.approx(0.5 * 2 * 0.8, abs=0.2)


def test_a_graded_bar_gives_way_at_its_soft_end(block):
    """Hung up by its stiff or its soft end, a bar is longer where the soft end carries the weight."""
    body = block((0.03, 0.03, 0.09), 0.005)
    material = Material(youngs_modulus_pa=2e4, poisson=0.3, damping_per_s=20)
    config = EngineConfig(dx_m=0.01, table_z_m=0.0, dt_s=3e-4)

    def height(ln_e: float) -> float:
        run = simulate(body, material, None, np.array([0, 1.2]), config, effects=[Layered(ln_e=ln_e)] if ln_e else [])
        return float(np.ptp(run.positions[-1][:, 2]))

    soft_top, even, soft_bottom = height(-0.7), height(0.0), height(0.7)
    # a column under its weight sinks by the integral of rho g (H - z) / E(z)
    z, h = np.linspace(0, 1, 1001), 0.09
    sunk = [np.trapezoid(9.81e3 * h * h * (1 - z) / (2e4 * np.exp(a * (2 * z - 1))), z) for a in (-0.7, 0.0, 0.7)]
    assert soft_bottom < even < soft_top
    assert even - soft_bottom == pytest.approx(sunk[2] - sunk[1], rel=0.25)
    assert soft_top - even == pytest.approx(sunk[1] - sunk[0], rel=0.25)
