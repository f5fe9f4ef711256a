"""Spread and degrees of freedom over few episodes: as the papers define them, and true where episodes tell unlike."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import sqrtm
from scipy.stats import t as student

from plop.statistics.cluster_robust import Clusters, clusters

NUMBERS = 25


def sampled(seed: int, sizes: list[float], columns: int = 2) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Design matrices [NUMBERS, C] and residuals [NUMBERS] of episodes that are sensitive by these factors."""
    draw = np.random.default_rng(seed)
    designs = [size * draw.normal(size=(NUMBERS, columns)) for size in sizes]
    return designs, [draw.normal(size=NUMBERS) for _ in sizes]


def fitted(designs: list[np.ndarray], residuals: list[np.ndarray]) -> Clusters:
    return clusters(
        np.stack([x.T @ x for x in designs]), np.stack([x.T @ r for x, r in zip(designs, residuals, strict=True)])
    )


@pytest.mark.parametrize("sizes", [[1.0] * 5, [3.0, 2.0, 0.3, 0.1]])
def test_spread_and_freedom_are_those_of_bell_and_mccaffrey_written_out_for_every_number(sizes):
    """With the hat matrix of all numbers, which the fit itself never builds."""
    designs, residuals = sampled(1, sizes)
    every, measured = np.concatenate(designs), np.concatenate(residuals)
    bread = np.linalg.inv(every.T @ every)
    maker = np.eye(len(every)) - every @ bread @ every.T
    left, meat, ways = maker @ measured, np.zeros((2, 2)), []
    for k, design in enumerate(designs):
        rows = slice(k * NUMBERS, (k + 1) * NUMBERS)
        righted = np.linalg.inv(sqrtm(maker[rows, rows]).real)
        score = design.T @ righted @ left[rows]
        meat += np.outer(score, score)
        ways.append(maker[rows].T @ righted @ design @ bread)
    found = fitted(designs, residuals)
    np.testing.assert_allclose(found.values, bread @ every.T @ measured, rtol=1e-6)
    np.testing.assert_allclose(found.spread, bread @ meat @ bread, rtol=1e-5)
    for c in range(2):
        p = np.stack([way[:, c] for way in ways], 1)
        omega = p.T @ p
        assert found.freedom[c] == pytest.approx(np.trace(omega) ** 2 / (omega**2).sum(), rel=1e-4)


def test_episodes_that_tell_alike_count_whole_and_two_that_tell_all_count_as_two():
    alike, two = (fitted(*sampled(2, sizes, columns=1)) for sizes in ([1.0] * 8, [30.0, 30.0] + [0.1] * 6))
    assert alike.freedom[0] == pytest.approx(7, rel=0.1)
    assert two.freedom[0] == pytest.approx(1, rel=0.05)


@pytest.mark.parametrize("sizes", [[1.0] * 6, [1.0, 1.0, 0.1, 0.1, 0.1, 0.1], [3.0, 1.0, 0.5, 0.3, 0.2, 0.1]])
def test_the_spread_is_true_on_average_and_the_chance_what_it_says(sizes):
    found = [fitted(*sampled(seed, sizes, columns=1)) for seed in range(600)]
    ratio = np.mean([f.spread[0, 0] for f in found]) / np.var([f.values[0] for f in found])
    assert ratio == pytest.approx(1, abs=0.25)
    p = np.array([2 * student.sf(abs(f.values[0]) / f.spread[0, 0] ** 0.5, f.freedom[0]) for f in found])
    assert (p < 0.02).mean() <= 0.035


def test_what_one_episode_alone_tells_has_no_known_scatter():
    designs, residuals = sampled(3, [1.0, 0.0, 0.0], columns=1)
    found = fitted(designs, residuals)
    assert found.spread[0, 0] == np.inf and np.isfinite(found.values).all()


def test_no_column_is_no_amplitude():
    assert clusters(np.zeros((3, 0, 0)), np.zeros((3, 0))).values.shape == (0,)
