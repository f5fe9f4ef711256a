"""Products, gains and chances against what they are defined as, written out with dense matrices."""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np
import pytest

from plop.diagnosis.calibration import chance, ways_to_deal
from plop.diagnosis.contrast import Products, roots
from plop.diagnosis.discrepancy import FREEDOM, SPREAD, Field, inducing_features, path_distances
from plop.diagnosis.evidence import PATH_STEPS, Evidence
from plop.diagnosis.unknown import Unknown

FRAMES, PATCHES, EPISODES = 4, 9, 5


def evidence(k: int, same_path_as: int | None = None, loose_m: float = 0.0) -> Evidence:
    draw = np.random.default_rng(k)
    path = np.random.default_rng([7, k if same_path_as is None else same_path_as]).uniform(0, 1, (PATH_STEPS, 8, 3))
    seen = np.ones((FRAMES, PATCHES), bool)
    seen[1, 2] = False
    residual = draw.normal(0, 1e-3, (FRAMES, PATCHES, 3))
    residual[-1, 0] += loose_m
    return Evidence(
        f"e{k}",
        0.06,
        np.arange(1, FRAMES + 1),
        residual * seen[..., None],
        draw.normal(0, 4e-3, (FRAMES, PATCHES, 3)),
        draw.uniform(1e-4, 3e-4, PATCHES),
        draw.uniform(0, 2e-4, (FRAMES, PATCHES)),
        seen,
        draw.uniform(-0.5, 0.5, (PATCHES, 3)),
        draw.uniform(-1, 1, (FRAMES, PATCHES, 3)),
        np.linspace(0.25, 1, FRAMES),
        path,
        1.0,
    )


@pytest.fixture(scope="module")
def episodes() -> list[Evidence]:
    return [*(evidence(k) for k in range(EPISODES - 1)), evidence(9, same_path_as=0)]


@pytest.fixture(scope="module")
def base(episodes) -> list[np.ndarray]:
    return [np.random.default_rng([3, k]).normal(0, 1e-3, (*e.residual.shape, 2)) for k, e in enumerate(episodes)]


@pytest.fixture(scope="module")
def field(episodes, base) -> Field:
    return Field(episodes, base)


def dense(episodes: list[Evidence], base: list[np.ndarray], field: Field) -> np.ndarray:
    """Covariance of all residuals that were seen, and nothing else."""
    size = episodes[0].residual.size
    alike = SPREAD.repeat * np.exp(-0.5 * (path_distances(episodes) / SPREAD.reach) ** 2)
    alike += (1 - SPREAD.repeat) * np.eye(len(episodes))
    features = inducing_features(episodes)
    found = np.zeros((len(episodes), size, len(episodes), size))
    shared = [np.concatenate([b.reshape(size, -1), u], 1) for b, u in zip(base, field.unknown, strict=True)]
    for e, one in enumerate(episodes):
        for f, other in enumerate(episodes):
            motion = [
                np.hypot(
                    m := np.linalg.norm(x.predicted, axis=-1), 0.2 * np.sqrt((m**2).mean(-1, keepdims=True))
                ).ravel()
                for x in (one, other)
            ]
            smooth = SPREAD.share**2 * np.outer(*motion) * (features[e] @ features[f].T)
            found[e, :, f] = alike[e, f] * np.kron(smooth, np.eye(3)) + shared[e] @ shared[f].T
        with np.errstate(divide="ignore"):
            noise = np.where(field.weights[e] > 0, 1 / field.weights[e], 1e12)
        found[e, :, e] += np.diag(np.repeat(noise, 3))
    return found.reshape(len(episodes) * size, -1)


def test_products_are_those_with_the_dense_inverse_covariance(episodes, base, field):
    responses = [
        [
            np.random.default_rng([5, law, k]).normal(0, 1e-3, e.residual.shape) * e.seen[..., None]
            for k, e in enumerate(episodes)
        ]
        for law in range(3)
    ]
    inverse = np.linalg.inv(dense(episodes, base, field))
    residual, size = np.concatenate([e.residual.ravel() for e in episodes]), episodes[0].residual.size
    for law, found in zip(responses, field.products(responses, [e.residual for e in episodes]), strict=True):
        wide = np.zeros((len(residual), EPISODES))
        for k, response in enumerate(law):
            wide[k * size : (k + 1) * size, k] = response.ravel()
        np.testing.assert_allclose(found.gram, wide.T @ inverse @ wide, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(found.onto, wide.T @ inverse @ residual, rtol=1e-5, atol=1e-5)


def test_a_part_that_broke_loose_loses_its_weight(episodes, base):
    loose = [evidence(0, loose_m=0.03), *episodes[1:]]
    weights = [Field(each, base).weights[0].reshape(FRAMES, PATCHES) for each in (episodes, loose)]
    assert weights[1][-1, 0] < 0.02 * weights[0][-1, 0] and weights[1][1, 2] == 0
    scale = episodes[0].variance_m2 + (SPREAD.rough * 0.06) ** 2
    assert (weights[0] <= (FREEDOM + 3) / (FREEDOM * scale) * (1 + 1e-9)).all()


def products(seed: int) -> Products:
    draw = np.random.default_rng(seed)
    root = draw.normal(size=(EPISODES, 8))
    return Products(root @ root.T, draw.normal(size=EPISODES) * 3 + 2)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("alone", [False, True])
def test_gains_are_differences_of_log_density_with_the_others_amounts(seed, alone):
    one = products(seed)
    labels = np.ones((1, EPISODES)) if alone else np.array([[1.0, 1, 0, 1, 0], [0, 1, 1, 0, 0], [0, 0, 1, 1, 1]])
    gains, amounts = one.held_out(labels)
    for row, z in enumerate(labels):
        for e in np.flatnonzero(z):
            others = np.arange(EPISODES) != e
            full = z[:, None] if alone else np.stack([z, np.ones(EPISODES)], 1)
            less = np.zeros((EPISODES, 0)) if alone else np.ones((EPISODES, 1))

            def fitted(design, others=others):
                left = design[others]
                solved = np.linalg.solve(left.T @ one.gram[np.ix_(others, others)] @ left, left.T @ one.onto[others])
                return design @ solved, solved

            def density(x, e=e, others=others):
                return x[e] * (one.onto[e] - one.gram[e, others] @ x[others]) - 0.5 * x[e] ** 2 * one.gram[e, e]

            total, solved = fitted(full)
            expected = max(solved[0], 0.0)
            assert amounts[row, e] == pytest.approx(expected, rel=1e-6, abs=1e-9)
            gain = density(total) - density(fitted(less)[0] if less.shape[1] else np.zeros(EPISODES))
            assert gains[row, e] == pytest.approx(gain if expected > 0 else 0.0, rel=1e-6, abs=1e-7)
        assert not gains[row][z == 0].any()
    assert one.strength(labels) == pytest.approx(roots(gains).sum(1))


def test_the_field_of_whatever_it_is_is_found_where_it_is_and_not_elsewhere(episodes, base, field):
    here = np.array([True, True, False, True, False])
    generator = np.random.default_rng(1)
    weights = generator.normal(size=field.unknown[0].shape[1])
    added = [
        e.residual + h * 3 * (u @ weights).reshape(e.residual.shape) * e.seen[..., None]
        for e, u, h in zip(episodes, field.unknown, here, strict=True)
    ]
    ways = ways_to_deal(here, ["m"] * EPISODES, 1)
    with_it, without = (Unknown.of(field, r).evidence(ways) for r in (added, [e.residual for e in episodes]))
    assert with_it.argmax() == 0 and with_it[0] > 50 and without[0] < 10
    assert Unknown.of(field, added).held_out(here).sum() > 0


def test_all_ways_are_dealt_once_within_kinds_where_these_leave_enough():
    here = np.array([True] * 4 + [False] * 4)
    kinds = ["press", "push"] * 4
    within = ways_to_deal(here, kinds, 36)
    assert len(within) == comb(4, 2) ** 2 == len({tuple(w) for w in within}) and (within[0] == here).all()
    assert all(w[::2].sum() == 2 and w[1::2].sum() == 2 for w in within)
    every = ways_to_deal(here, kinds, 37)
    assert {tuple(np.flatnonzero(w)) for w in every} == {*combinations(range(8), 4)}
    many = ways_to_deal(np.array([True] * 9 + [False] * 9), ["m"] * 18, 1, seed=3)
    assert len(many) == 2000 and (many.sum(1) == 9).all()
    np.testing.assert_array_equal(many, ways_to_deal(np.array([True] * 9 + [False] * 9), ["m"] * 18, 1, seed=3))


def test_a_chance_counts_the_real_way_and_is_never_zero():
    found = np.array([5.0, 1.0, 5.0, 7.0])
    assert chance(5.0, found) == 0.75 and chance(100.0, found) == 0.25 and chance(0.0, found) == 1.0
