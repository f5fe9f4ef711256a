"""Conformal quantiles, spread and scores where the truth is known."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.stats import binom, chi2

from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.tracking.episode import Episode
from plop.uncertainty.band import LEVEL, NOMINAL, Band, calibrated
from plop.uncertainty.conformal import group_quantile, least_groups
from plop.uncertainty.errors import PointErrors, point_errors
from plop.uncertainty.scores import score, score_bands
from plop.uncertainty.spread import ensemble_spread, spread_at
from tests.support.coarse_episodes import coarse_episode, gaussians

TRUE_M = 0.002


def episode(name: str, random: np.random.Generator, spread_m: float, *, scale: float = 1.0) -> PointErrors:
    """Errors of one coordinate have the standard deviation `scale` times 2 mm, whatever the spread says."""
    frames, points = 11, 40
    error = random.normal(0, scale * TRUE_M, (frames, points, 3))
    counts = np.ones((frames, points), bool)
    counts[0] = False
    spread = np.full((frames, points), spread_m)
    return PointErrors(name, np.arange(frames) * 0.1, error, 3 * error, spread, counts, 1e-6)


def test_one_score_a_group_gives_the_order_statistic_of_split_conformal():
    scores = [np.array([float(k)]) for k in np.random.default_rng(0).permutation(19) + 1]
    assert group_quantile(scores, 0.9) == (18.0, True)  # ceil(0.9 * 20)
    assert group_quantile(scores[:9], 0.9) == (max(float(s[0]) for s in scores[:9]), True)
    assert least_groups(0.9) == 9 and not group_quantile(scores[:8], 0.9)[1]


def test_a_group_counts_once_however_many_scores_it_has():
    few = [np.arange(10.0)] * 29
    alike = [group_quantile([*few, np.full(count, 100.0)], 0.9) for count in (1, 10, 10**5)]
    assert alike == [(9.0, True)] * 3


@pytest.mark.parametrize("grouped", [0.0, 0.5, 5.0])
def test_a_point_of_a_new_episode_is_inside_as_often_as_promised(grouped):
    """With scores that differ little, much, or almost only between episodes."""
    random, trials, inside = np.random.default_rng(1), 1500, 0
    for _ in range(trials):
        *known, new = np.exp(grouped * random.normal(size=(20, 1)) + 0.2 * random.normal(size=(20, 15)))
        inside += new[0] <= group_quantile(known, 0.9)[0]
    assert inside >= binom.ppf(0.001, trials, 0.9)
    most = 0.9 if grouped == 5 else 0.9 * 20 / 19  # what it exceeds where episodes are alike
    assert inside <= binom.ppf(0.999, trials, most)


@pytest.mark.parametrize("confidence", [1.0, 2.0, 0.5])
def test_scores_of_normal_errors_are_the_analytic_ones(confidence):
    sigma = TRUE_M / confidence
    found = score(np.random.default_rng(2).normal(0, TRUE_M, (40_000, 3)), np.full(40_000, sigma))
    crps = np.sqrt(2 / np.pi) * np.hypot(sigma, TRUE_M) - sigma / np.sqrt(np.pi)
    assert found["coverage"] == pytest.approx(chi2.cdf((NOMINAL / confidence) ** 2, 3), abs=0.006)
    assert found["nees"] == pytest.approx(confidence**2, rel=0.02)
    assert found["crps_mm"] == pytest.approx(1000 * crps, rel=0.02)
    assert found["radius_mm"] == pytest.approx(1000 * NOMINAL * sigma)


@pytest.mark.parametrize("confidence", [1.0, 2.0, 0.5])
def test_the_factor_repairs_a_spread_that_is_too_small_or_too_large(confidence):
    random = np.random.default_rng(3)
    band = calibrated([episode(f"v{k}", random, TRUE_M / confidence) for k in range(99)], models=3)
    assert band.guaranteed and band.factor == pytest.approx(confidence, rel=0.04)
    scores = score_bands([episode(f"t{k}", random, TRUE_M / confidence) for k in range(40)], band, {})
    widened, persistence = scores.methods["widened"], scores.methods["persistence"]
    assert widened["coverage"].mean == pytest.approx(0.91, abs=0.02)
    assert widened["nees"].mean == pytest.approx(1, abs=0.1)
    assert scores.methods["ensemble"]["nees"].mean == pytest.approx(confidence**2, rel=0.05)
    assert persistence["radius_mm"].mean == pytest.approx(3 * widened["radius_mm"].mean, rel=0.05)
    assert persistence["crps_mm"].mean > 2 * widened["crps_mm"].mean
    assert scores.episodes["t0"]["widened"]["coverage_end"] <= 1


def test_a_spread_that_follows_the_error_is_sharper_than_one_radius():
    random = np.random.default_rng(4)
    made = [episode(f"e{k}", random, TRUE_M * s, scale=s) for k, s in enumerate(random.choice([0.2, 2.0], 60))]
    scores = score_bands(made[30:], calibrated(made[:30], models=3), {})
    assert scores.methods["widened"]["crps_mm"].mean < scores.methods["constant"]["crps_mm"].mean
    assert scores.methods["widened"]["radius_mm"].mean < 0.8 * scores.methods["constant"]["radius_mm"].mean


def test_without_spread_the_noise_remains_and_the_file_is_read_back(tmp_path):
    made = episode("a", np.random.default_rng(5), 0.0)
    made.write(tmp_path / "validation" / "a.npz")
    again = PointErrors.read(tmp_path / "validation" / "a.npz")
    assert again.name == "a" and np.array_equal(again.error_m, made.error_m)
    band = calibrated([again], models=2)
    assert not band.guaranteed and np.isfinite(band.factor) and band.radius_m(np.zeros(2)).min() > 0
    band.write(tmp_path)
    assert Band.load(tmp_path) == band and band.level == LEVEL


def places(count: int = 60) -> Gaussians:
    return gaussians(np.random.default_rng(0).uniform(-0.03, 0.03, (count, 3)))


def test_spread_is_the_distance_of_the_others_through_split_and_merge():
    first = places()
    off = torch.tensor([0.003, 0.0, 0.0])
    now = first.select(torch.cat([torch.arange(59, 9, -1), torch.tensor([20, 20])]))  # merged: ten; split: one
    others = [first.with_(means=first.means + off), first.with_(means=first.means - off)]
    spread = ensemble_spread(first, now, others)
    np.testing.assert_allclose(spread, np.full(len(now), 0.003 / np.sqrt(3)), rtol=1e-4)
    np.testing.assert_allclose(spread_at(first, now, spread, first.means.numpy()), spread[0], rtol=1e-4)


def test_where_the_truth_is_like_a_member_the_spread_is_the_error():
    random, first = np.random.default_rng(6), places(400)
    drawn = [first.with_(means=first.means + torch.from_numpy(random.normal(0, 0.001, 3)).float()) for _ in range(600)]
    spreads = [ensemble_spread(first, drawn[k], drawn[k + 1 : k + 3])[0] for k in range(0, 600, 6)]
    errors = [float((drawn[k].means - drawn[k + 5].means)[0].square().mean()) for k in range(0, 600, 6)]
    assert np.mean(np.square(spreads)) == pytest.approx(np.mean(errors), rel=0.25)


def test_frame_0_and_hidden_points_do_not_count_and_lengths_must_agree():
    tracked: Episode = coarse_episode(1)
    first = gaussians(tracked.points[0])
    frames = [(first, np.full(len(first), 1e-3))] * len(tracked.times)
    found = point_errors(tracked, frames)
    assert not found.counts[0].any() and found.counts[1:].any()
    np.testing.assert_allclose(found.error_m, found.motion_m, atol=1e-6)  # nothing moves
    with pytest.raises(PlopError, match="differ in length"):
        point_errors(tracked, frames[:-1])
