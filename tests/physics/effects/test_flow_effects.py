"""Effects that change the stress-free shape: plastic flow and growth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import polar

from plop.physics.effects.plasticity import Plasticity
from plop.physics.effects.swelling import Swelling
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import ElasticLaw, Material
from plop.physics.engine.solver import simulate


def random_f(count: int = 40) -> np.ndarray:
    """Deformation gradients from small to large, and two with a double and a triple eigenvalue."""
    noise = np.random.default_rng(2).normal(0, 1, (count, 3, 3)) * np.geomspace(0.003, 0.25, count)[:, None, None]
    return np.concatenate([np.eye(3) + noise, [np.diag([1.5, 1, 1]), 1.1 * np.eye(3)]]).astype(np.float32)


def equivalent_pa(f: np.ndarray, material: Material) -> np.ndarray:
    """Von Mises stress from singular values, [N] [Pa]."""
    s, mu = np.linalg.svd(f.astype(float), compute_uv=False), material.shear_pa
    tau = {
        ElasticLaw.NEO_HOOKEAN: mu * s**2,
        ElasticLaw.FIXED_COROTATED: 2 * mu * (s - 1) * s,
        ElasticLaw.STABLE_NEO_HOOKEAN: mu * (1 - 1 / ((s**2).sum(1, keepdims=True) + 1)) * s**2,
    }
    deviator = tau[material.law] - tau[material.law].mean(1, keepdims=True)
    return np.sqrt(1.5 * (deviator**2).sum(1))


@pytest.mark.parametrize("law", list(ElasticLaw))
def test_stress_is_capped_and_volume_and_rotation_are_kept(strained, law):
    f, effect = random_f(), Plasticity(softness_per_kpa=0.5, hardening=0)
    material = Material(youngs_modulus_pa=2e4, poisson=0.3, law=law)
    engine = strained(f, [effect], material)
    before = equivalent_pa(f, material)
    effect.after(engine, 1e-4)
    after = equivalent_pa(engine.f, material)
    yielded = before > effect.yield_pa
    assert effect.yield_pa == 2000 and 5 < yielded.sum() < len(f) - 5
    np.testing.assert_allclose(after[yielded], 2000, rtol=2e-3)
    assert (engine.f[~yielded] == f[~yielded]).all()
    np.testing.assert_allclose(np.linalg.det(engine.f), np.linalg.det(f), rtol=1e-4)
    for old, new in zip(f, engine.f, strict=True):
        np.testing.assert_allclose(polar(new.astype(float))[0], polar(old.astype(float))[0], atol=1e-4)


def test_hardening_lets_the_stress_grow_with_the_flow(strained):
    f, effect = random_f(), Plasticity(softness_per_kpa=2.0, hardening=0.2)
    material = Material(youngs_modulus_pa=2e4, poisson=0.3)
    engine = strained(f, [effect], material)
    flows = []
    for _ in range(2):
        effect.after(engine, 1e-4)
        flow = engine.memory["plasticity.flow"].astype(float)
        yielded = flow > 0
        expected = 500 + 3 * material.shear_pa * 0.2 * flow[yielded]
        np.testing.assert_allclose(equivalent_pa(engine.f, material)[yielded], expected, rtol=2e-3)
        flows.append(flow)
    # what has flowed once is admissible: nothing flows a second time
    np.testing.assert_allclose(flows[1], flows[0], atol=1e-5)
    logarithm = [np.log(np.linalg.svd(g.astype(float), compute_uv=False)) for g in (f, engine.f)]
    size = [np.sqrt(2 / 3 * ((e - e.mean(1, keepdims=True)) ** 2).sum(1)) for e in logarithm]
    np.testing.assert_allclose(size[0] - size[1], flows[0], atol=1e-5)


def test_pressed_beyond_yield_it_pushes_back_less_and_stays_flat(block, plate):
    body = block((0.03, 0.03, 0.03), 0.005)
    motion = plate((0, 0.0302), (0, 0.0264), (0, 0.0264), (0, 0.04), times=[0, 0.2, 0.3, 0.4])
    material = Material(youngs_modulus_pa=2e4, poisson=0.3, table_friction=0, tool_friction=0, damping_per_s=20)
    config, times = EngineConfig(dx_m=0.01, gravity_m_s2=(0, 0, 0)), np.array([0, 0.25, 0.3, 0.5, 0.6])
    elastic = simulate(body, material, motion, times, config)
    plastic = simulate(body, material, motion, times, config, effects=[Plasticity(softness_per_kpa=2.0)])
    strain, slope = np.log(0.03 / 0.0264), 0.1 * 3 * material.shear_pa
    # sigma = Y + H flow and strain = sigma / E + flow; pressing makes the area larger
    flow = (strain - 500 / 2e4) / (1 + slope / 2e4)
    expected = (500 + slope * flow) * 0.03**2 * np.exp(flow)
    assert -plastic.tool_force[2, 2] == pytest.approx(expected, rel=0.12)
    assert elastic.tool_force[2, 2] < 2 * plastic.tool_force[2, 2]
    lost = [1 - np.ptp(run.positions[-1, :, 2]) / np.ptp(run.positions[0, :, 2]) for run in (elastic, plastic)]
    assert abs(lost[0]) < 0.02
    assert lost[1] == pytest.approx(flow, rel=0.2)


def test_free_block_grows_as_the_rate_says_and_stays_without_stress(block):
    body = block((0.04, 0.03, 0.03), 0.005)
    material = Material(youngs_modulus_pa=2e4, damping_per_s=50)
    run = simulate(
        body,
        material,
        None,
        np.array([0, 0.4]),
        EngineConfig(gravity_m_s2=(0, 0, 0), table_z_m=None),
        effects=[Swelling(rate_per_s=-0.3)],
    )
    size = np.ptp(run.positions, axis=1)
    np.testing.assert_allclose(np.log(size[1] / size[0]), -0.3 * 0.4 / 3, rtol=0.05)
    assert np.abs(run.F[-1] - np.eye(3)).max() < 0.004
