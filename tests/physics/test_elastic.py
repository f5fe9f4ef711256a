"""The stresses against the derivative of their energies, and the polar factor against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import polar

from plop.physics.engine.kernels.elastic import kirchhoff_stress
from plop.physics.engine.material import ElasticLaw

MU, LAME = 3.0, 7.0


def energy(law: ElasticLaw, f: np.ndarray) -> float:
    j, first = np.linalg.det(f), np.sum(f * f)
    if law == ElasticLaw.NEO_HOOKEAN:
        return MU / 2 * (first - 3) - MU * np.log(j) + LAME / 2 * np.log(j) ** 2
    if law == ElasticLaw.FIXED_COROTATED:
        return MU * np.sum((f - polar(f)[0]) ** 2) + LAME / 2 * (j - 1) ** 2
    alpha = 1 + 0.75 * MU / LAME
    return MU / 2 * (first - 3) + LAME / 2 * (j - alpha) ** 2 - MU / 2 * np.log(first + 1)


def stress(law: ElasticLaw, f: np.ndarray) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = kirchhoff_stress(int(law), *f.ravel(), MU, LAME)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize("law", list(ElasticLaw))
@pytest.mark.parametrize("seed", range(4))
def test_stress_is_the_derivative_of_the_energy(law, seed):
    f = np.eye(3) + np.random.default_rng(seed).uniform(-0.25, 0.25, (3, 3))
    step, first_piola = 1e-5, np.zeros((3, 3))
    for i in range(3):
        for k in range(3):
            change = np.zeros((3, 3))
            change[i, k] = step
            first_piola[i, k] = (energy(law, f + change) - energy(law, f - change)) / (2 * step)
    np.testing.assert_allclose(stress(law, f), first_piola @ f.T, atol=2e-5 * MU)


@pytest.mark.parametrize("law", list(ElasticLaw))
def test_rest_is_free_of_stress_and_rotations_do_not_strain(law):
    rotation = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    np.testing.assert_allclose(stress(law, np.eye(3)), 0, atol=1e-6)
    np.testing.assert_allclose(stress(law, rotation), 0, atol=1e-6)


@pytest.mark.parametrize("law", [ElasticLaw.NEO_HOOKEAN, ElasticLaw.FIXED_COROTATED])
def test_small_strain_is_hooke(law):
    strain = 1e-4 * np.array([[1.0, 0.3, -0.2], [0.3, -0.5, 0.1], [-0.2, 0.1, 0.4]])
    hooke = 2 * MU * strain + LAME * np.trace(strain) * np.eye(3)
    np.testing.assert_allclose(stress(law, np.eye(3) + strain), hooke, rtol=5e-3, atol=2e-6)


def test_stable_law_is_softer_at_small_strain():
    shear = 1e-4
    f = np.eye(3)
    f[0, 1] = shear
    assert stress(ElasticLaw.STABLE_NEO_HOOKEAN, f)[0, 1] == pytest.approx(0.75 * MU * shear, rel=1e-3)
