"""Products, gains and chances against what they are defined as, written out with dense matrices."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product
from math import comb

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from plop.diagnosis.evidence.amounts import Contrast, contrast, own_amounts
from plop.diagnosis.evidence.contrast import Products, roots
from plop.diagnosis.evidence.discrepancy import SPREAD, Field, inducing_features, path_distances
from plop.diagnosis.evidence.evidence import PATH_STEPS, Evidence
from plop.diagnosis.evidence.noise import Scales, repeats_of
from plop.diagnosis.rule import RULE
from plop.diagnosis.scores.calibration import LEAST, ByChance, balanced, between_repeats, chance, ways_to_deal
from plop.diagnosis.scores.unknown import Unknown
from plop.statistics.heavy_tails import FREEDOM

FRAMES, PATCHES, EPISODES = 12, 20, 5


def evidence(k: int, same_path_as: int | None = None, loose_m: float = 0.0) -> Evidence:
    draw = np.random.default_rng(k)
    path = np.random.default_rng([7, k if same_path_as is None else same_path_as]).uniform(0, 1, (PATH_STEPS, 8, 3))
    seen = np.ones((FRAMES, PATCHES), bool)
    seen[1, 2] = False
    if same_path_as is not None:
        seen[2, 5] = False
    residual = draw.normal(0, 1e-3, (FRAMES, PATCHES, 3))
    residual[-1, 0] += loose_m
    place = np.random.default_rng([8, k if same_path_as is None else same_path_as]).uniform(-0.5, 0.5, (PATCHES, 3))
    return Evidence(
        f"e{k}",
        0.06,
        np.arange(1, FRAMES + 1),
        residual * seen[..., None],
        draw.normal(0, 4e-3, (FRAMES, PATCHES, 3)),
        draw.uniform(1e-4, 3e-4, PATCHES),
        draw.uniform(0, 2e-4, (FRAMES, PATCHES)),
        seen,
        place,
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


def apart(episodes: list[Evidence]) -> np.ndarray:
    return path_distances([e.tool_path for e in episodes], [e.duration_s for e in episodes])


def dense(episodes: list[Evidence], base: list[np.ndarray], field: Field) -> np.ndarray:
    """Covariance of all residuals that were seen, and nothing else."""
    size = episodes[0].residual.size
    alike = SPREAD.repeat * np.exp(-0.5 * (apart(episodes) / SPREAD.reach) ** 2)
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
    precision = np.zeros((len(episodes), size // 3, len(episodes), size // 3))
    for e, row in enumerate(field.noise.inverse):
        for f, weights in row.items():
            precision[e, :, f] = np.diag(np.maximum(weights, 1e-12) if e == f else weights)
    noise = np.linalg.inv(precision.reshape(len(episodes) * size // 3, -1))
    return found.reshape(len(episodes) * size, -1) + np.kron(noise, np.eye(3))


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
    weights = [Field(each, base).noise.weights[0].reshape(FRAMES, PATCHES) for each in (episodes, loose)]
    assert weights[1][-1, 0] < 0.02 * weights[0][-1, 0] and weights[1][1, 2] == 0
    scale = episodes[0].variance_m2 + (SPREAD.rough * 0.06) ** 2
    assert (weights[0] <= (FREEDOM + 3) / (FREEDOM * scale) * (1 + 1e-9)).all()


def test_repeats_differ_by_the_measurement_alone(episodes):
    """Before anything is known of the residuals the covariance is that of the model."""
    kernel = np.full((EPISODES, EPISODES), SPREAD.repeat) + (1 - SPREAD.repeat) * np.eye(EPISODES)
    repeats = repeats_of(apart(episodes))
    scales = Scales.of(episodes, SPREAD.rough, kernel, repeats)
    assert [group.tolist() for group in scales.groups] == [[0, EPISODES - 1], [1], [2], [3]]
    found = scales.noise(None)
    both = [found.inverse[e][f].reshape(FRAMES, PATCHES) for e in (0, EPISODES - 1) for f in (0, EPISODES - 1)]
    for frame, patch in ((0, 0), (3, 7)):
        one, other = episodes[0], episodes[-1]
        measured = np.mean([e.noise_m[patch] ** 2 for e in (one, other)])
        missed = np.mean([e.spread_m[frame, patch] ** 2 for e in (one, other)]) + (SPREAD.rough * 0.06) ** 2
        expected = np.linalg.inv(measured * np.eye(2) + missed * np.array([[1, SPREAD.repeat], [SPREAD.repeat, 1]]))
        np.testing.assert_allclose([each[frame, patch] for each in both], expected.ravel(), rtol=1e-9)
    own, across, _, other = both
    assert own[1, 2] == other[1, 2] == other[2, 5] == across[2, 5] == 0 < own[2, 5]  # hidden in one, or in both
    last = episodes[-1]
    fewer = replace(last, seen=last.seen[:, 1:], noise_m=last.noise_m[1:], spread_m=last.spread_m[:, 1:])
    assert len(Scales.of([*episodes[:-1], fewer], SPREAD.rough, kernel, repeats).groups) == EPISODES


def products(seed: int) -> Products:
    draw = np.random.default_rng(seed)
    root = draw.normal(size=(EPISODES, 8))
    return Products(root @ root.T, draw.normal(size=EPISODES) * 3 + 2)


def density(values: np.ndarray, mean: np.ndarray, covariance: np.ndarray, given: np.ndarray) -> float:
    """Log density of Gaussian values, some of them given."""
    known = multivariate_normal(mean[given], covariance[np.ix_(given, given)]).logpdf(values[given])
    return float(multivariate_normal(mean, covariance).logpdf(values) - known)


def test_own_amounts_are_what_an_episode_shows_beyond_what_all_show():
    here, told = np.array([True, True, True, False, False]), 1e6 * np.eye(EPISODES)
    gram = np.einsum("ef,k,l->ekfl", told, [1.0, 2.0], [1.0, 2.0])  # two settings of a law that is in proportion
    onto = np.outer(told @ [2, 3, 4, 1, 1], [1.0, 2.0])
    np.testing.assert_allclose(own_amounts(gram, onto, here) @ [1, 2], [1, 2, 3, 0, 0], atol=1e-4)
    everywhere = own_amounts(gram, onto, np.ones(EPISODES, bool))
    np.testing.assert_allclose(everywhere @ [1, 2], [2, 3, 4, 1, 1], atol=1e-4)  # no reference: there is nothing beyond
    assert np.abs(own_amounts(1e-9 * gram, 1e-9 * onto, here)).max() < 0.02  # of what tells nothing, nothing is taken


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("alone", [False, True])
def test_gains_are_differences_of_log_density_given_all_others(seed, alone):
    """Amounts of episodes are Gaussian: the inverse of the products, and what the engine is off by in a motion."""
    alike = np.eye(EPISODES)
    if seed % 2:
        alike[0, 4] = alike[4, 0] = 1.0
    one, every = replace(products(seed), repeats=alike if seed % 2 else None), np.ones(EPISODES, bool)
    covariance, off = np.linalg.inv(one.gram), RULE.response_error
    single = covariance @ one.onto
    labels = np.ones((1, EPISODES)) if alone else np.array([[1.0, 1, 0, 1, 0], [0, 1, 1, 0, 0], [0, 0, 1, 1, 1]])
    gains, amounts = one.held_out(labels)
    tested = np.zeros(gains.shape)

    def fitted(design, of, scatter=off):
        """Give the amount of every episode, and what it is made of."""
        precision = np.linalg.inv((covariance + scatter**2 * alike)[np.ix_(of, of)])
        left = design[of]
        solved = np.linalg.solve(left.T @ precision @ left, left.T @ precision @ single[of])
        return design @ solved, solved

    for row, z in enumerate(labels):
        less = np.zeros((EPISODES, 0)) if alone else np.ones((EPISODES, 1))
        design = np.concatenate([z[:, None], less], 1)
        mean, without = fitted(design, every), fitted(less, every)[0]
        scatter = mean[0] if mean[1][0] > 0 else without
        for e in range(EPISODES):
            others = np.arange(EPISODES) != e
            total, solved = fitted(design, others)
            expected = max(solved[0], 0.0)
            assert amounts[row, e] == pytest.approx(z[e] * expected, rel=1e-6, abs=1e-9)

            def log_density(amount, scatter, others=others):
                return density(single, amount, covariance + off**2 * np.outer(scatter, scatter) * alike, others)

            none = log_density(fitted(less, others, 0.0)[0], 0 * single)
            gain = log_density(total, scatter) - none
            assert gains[row, e] == pytest.approx(gain if expected > 0 else 0.0, rel=1e-6, abs=1e-7)
            rigid, (a, *_) = fitted(design, others, 0.0)
            tested[row, e] = (log_density(rigid, 0 * single) - none) * (a > 0)
    assert one.strength(labels) == pytest.approx(roots(tested).sum(1), rel=1e-6, abs=1e-6)


def test_an_episode_that_tells_nothing_of_a_law_gains_nothing():
    found = Products(np.diag([0.0, 50.0, 80.0, 0.0, 60.0]), np.array([0.0, 50.0, 80.0, 0.0, 0.0]))
    gains, amounts = found.held_out(np.array([[1.0, 1, 1, 0, 0]]))
    assert gains[0, 0] == gains[0, 3] == 0 and amounts[0, 0] > 0
    assert (gains[0, 1:3] > 0).all() and np.isfinite(gains).all()


def test_a_law_is_found_though_the_engine_is_wrong_in_the_motion_that_moves_most():
    """Five episodes show all of it; a sixth, of which ten times as much is known, a tenth."""
    told, amounts = np.array([100.0] * 5 + [1e4] + [100.0] * 5 + [1e4]), np.array([1.0] * 5 + [0.1] + [0.0] * 6)
    found = Products(np.diag(told), told * amounts)
    (gains,), (predicted,) = found.held_out(np.array([[1.0] * 6 + [0.0] * 6]))
    assert (gains[:5] > 5).all() and gains[5] > -10 and (predicted[:5] > 0.7).all()


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
    whatever = Unknown.of(field, added)
    assert 0 < whatever.held_out(here).sum() < whatever.alone(here) < whatever.alone(np.ones(EPISODES, bool))


def test_the_gain_of_a_field_is_a_difference_of_log_density_given_all_others():
    draw = np.random.default_rng(4)
    root = draw.normal(size=(EPISODES * 2, 14))
    gram, onto, here = root @ root.T, draw.normal(size=EPISODES * 2) * 3, np.array([1.0, 1, 0, 1, 0])
    covariance, design = np.linalg.inv(gram), np.kron(here[:, None], np.eye(2))
    single = covariance @ onto
    gains = Unknown(gram.reshape(EPISODES, 2, EPISODES, 2), onto.reshape(EPISODES, 2)).held_out(here > 0)
    for found, e in zip(gains, np.flatnonzero(here), strict=True):
        others = np.repeat(np.arange(EPISODES) != e, 2)
        precision = np.linalg.inv(covariance[np.ix_(others, others)])
        left = design[others]
        weights = np.linalg.solve(left.T @ precision @ left + np.eye(2), left.T @ precision @ single[others])

        means = (design @ weights, 0 * single)
        gain = np.subtract(*(density(single, mean, covariance, others) for mean in means))
        assert found == pytest.approx(gain, rel=1e-6)


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


def test_where_every_motion_is_repeated_episodes_change_places_with_repeats_only():
    here = np.array([True, True, False, False, False])
    every = ways_to_deal(here, ["m"] * 5, 1)
    ways = between_repeats(here, [np.array([0, 2]), np.array([1, 3, 4])], every)
    assert len(ways) == 2 * 3 and (ways[0] == here).all() and (ways[:, [0, 2]].sum(1) == 1).all()
    assert between_repeats(here, [np.array([0, 2, 3, 4]), np.array([1])], every) is every


def test_in_balanced_ways_what_is_hidden_is_on_both_sides_alike():
    here = np.array([True] * 6 + [False] * 6)
    ways = ways_to_deal(here, ["press", "push", "drag"] * 4, 1)
    kept = balanced(ways)
    assert len(kept) == 4**3 + 6 * 4 and (kept[:, :6].sum(1) == 3).all() and (kept.sum(1) == 6).all()
    odd = balanced(ways_to_deal(np.array([True] * 3 + [False] * 3), [str(k % 3) for k in range(6)], 1))
    assert {tuple(w[:3]) for w in odd} == {w for w in product((0.0, 1.0), repeat=3) if 0 < sum(w) < 3}


def test_what_the_noise_of_the_model_may_gain_is_no_law_however_little_the_other_ways_find():
    quiet = ByChance(np.zeros(64), tried=50, episodes=6)
    assert quiet.chance(1.5, 4.0) == quiet.chance(4.0, 4.0) == 1.0 and quiet.chance(8.0, 4.0) == LEAST
    assert quiet.chance(quiet.critical(0.01, 4.0), 4.0) == pytest.approx(0.01, rel=1e-3)
    assert quiet.critical(0.01, 4.0) == pytest.approx(np.sqrt(3 * chi2.isf(0.01 / 50, 1)), rel=1e-3)


def test_a_chance_counts_the_real_way_and_is_never_zero():
    found = np.array([5.0, 1.0, 5.0, 7.0])
    assert chance(5.0, found) == 0.75 and chance(100.0, found) == 0.25 and chance(0.0, found) == 1.0


def test_amounts_that_differ_between_episodes_are_fitted_with_their_covariance():
    draw = np.random.default_rng(5)
    here, design = np.array([True] * 4 + [False] * 3), np.ones((7, 2))
    design[4:, 0] = 0
    root = draw.normal(size=(7, 9))
    gram, onto, spread = root @ root.T, draw.normal(size=7) * 3, 0.4
    precision = np.linalg.inv(gram + spread**2 * gram @ gram)
    wanted = np.linalg.solve(design.T @ gram @ precision @ gram @ design, design.T @ gram @ precision @ onto)
    assert contrast(gram[:, None, :, None], onto[:, None], here, np.eye(7), spread).amount == pytest.approx(wanted[0])
    alike = np.linalg.solve(design.T @ gram @ design, design.T @ onto)
    assert contrast(gram[:, None, :, None], onto[:, None], here, np.eye(7)).amount == pytest.approx(alike[0])


def test_two_motions_of_which_most_is_known_do_not_decide_alone_how_much_of_a_law_there_is():
    """They show 0.4 of it, and four others all of it: the mean is 0.8."""
    told, amounts = np.array([900.0] * 2 + [100.0] * 4), np.array([0.4] * 2 + [1.0] * 4)
    found, here = Products(np.diag(told), told * amounts), np.ones(6, bool)

    def rigid(one: Products) -> Contrast:
        return contrast(one.gram[:, None, :, None], one.onto[:, None], here, np.eye(6))

    typical = found.typical(here)
    assert rigid(found).amount < 0.55
    assert 0.7 < typical.amount < 0.8 and 0.1 < typical.error < 0.25
    same, against = Products(np.diag(told), told * 0.7), Products(np.diag(told), -told * amounts)
    assert same.typical(here).amount == pytest.approx(0.7) == rigid(same).amount
    assert against.typical(here).amount < 0
