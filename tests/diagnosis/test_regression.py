"""Least squares over episodes: the same as refitting by hand; the known misfit is found and nothing is invented."""

from __future__ import annotations

import numpy as np
import pytest

from plop.diagnosis.evidence import Whitened
from plop.diagnosis.regression import Grams, fit, gain, held_out_energy, held_out_values, known_misfit, solve


def episodes(count: int = 5, columns: int = 3, *, seed: int = 0, mix: tuple[float, ...] = (), noise: float = 1.0):
    generator = np.random.default_rng(seed)
    found = []
    for k in range(count):
        matrix = generator.normal(size=(columns, 60))
        residual = noise * generator.normal(size=60) + np.asarray(mix or np.zeros(columns)) @ matrix
        found.append(Whitened(f"e{k}", residual, matrix, (4, 5), np.arange(5)))
    return found


@pytest.mark.parametrize("columns", [[0], [0, 2], [2, 1, 0]])
def test_held_out_energy_is_that_of_a_fit_to_all_others(columns):
    data = episodes(mix=(1.0, -2.0, 0.5))
    grams = Grams.of(data)
    for k, left_out in enumerate(data):
        others = [e for e in data if e is not left_out]
        stacked = np.concatenate([e.matrix[columns] for e in others], 1).T
        values = np.linalg.lstsq(stacked, np.concatenate([e.residual for e in others]), rcond=None)[0]
        expected = ((left_out.residual - values @ left_out.matrix[columns]) ** 2).sum()
        assert held_out_energy(grams, np.array(columns))[k] == pytest.approx(expected, rel=1e-6)
        np.testing.assert_allclose(held_out_values(grams, np.array(columns))[k], values, rtol=1e-6)


def test_no_column_leaves_the_residuals():
    data = episodes()
    none = held_out_energy(Grams.of(data), np.array([], int))
    np.testing.assert_allclose(none, [(e.residual**2).sum() for e in data])


def test_a_column_without_response_gets_nothing_and_harms_nothing():
    hessian = np.array([[4.0, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(solve(hessian, np.array([2.0, 0.0])), [0.5, 0.0])


def test_fit_is_least_squares():
    data = episodes(mix=(1.0, -2.0, 0.5))
    found = fit(Grams.of(data), np.arange(3))
    stacked = np.concatenate([e.matrix for e in data], 1).T
    values = np.linalg.lstsq(stacked, np.concatenate([e.residual for e in data]), rcond=None)[0]
    np.testing.assert_allclose(found.values, values, rtol=1e-6)


def test_spread_does_not_depend_on_the_units_of_a_column():
    data = episodes(mix=(1.0, -2.0, 0.5))
    scaled = [Whitened(e.name, e.residual, e.matrix * [[1e6], [1.0], [1e-6]], e.shape, e.block) for e in data]
    plain, other = fit(Grams.of(data), np.arange(3)), fit(Grams.of(scaled), np.arange(3))
    np.testing.assert_allclose(other.values * [1e6, 1, 1e-6], plain.values, rtol=1e-6)
    np.testing.assert_allclose(
        np.sqrt(np.diag(other.spread)) * [1e6, 1, 1e-6], np.sqrt(np.diag(plain.spread)), rtol=1e-5
    )


def test_known_misfit_finds_a_planted_mixture():
    grams = Grams.of(episodes(columns=6, mix=(0.5, 0, 2.0, 0, -1.5, 0)))
    values, left = known_misfit(grams, np.array([0]), [np.array([k]) for k in range(1, 6)])
    np.testing.assert_allclose(values, [0.5, 0, 2.0, 0, -1.5, 0], atol=0.25)
    assert (values[[1, 3, 5]] == 0).all()
    assert left.sum() == pytest.approx(5 * 60, rel=0.2)  # what is left is the noise


def test_known_misfit_finds_nothing_in_noise():
    for seed in range(10):
        grams = Grams.of(episodes(columns=6, seed=seed))
        values, _ = known_misfit(grams, np.array([0]), [np.array([k]) for k in range(1, 6)])
        assert (values[1:] == 0).all()


def test_too_few_reference_episodes_describe_nothing():
    grams = Grams.of(episodes(2, mix=(3.0, 3.0, 3.0)))
    values, left = known_misfit(grams, np.array([0]), [np.array([1])])
    assert not values.any()
    np.testing.assert_array_equal(left, grams.energy)


def test_gain_is_the_share_that_is_gone():
    assert gain(np.array([3.0, 1.0]), np.array([0.5, 0.5])) == pytest.approx(0.75)
    assert gain(np.zeros(2), np.zeros(2)) == pytest.approx(1.0)  # nothing was wrong: nothing is left
