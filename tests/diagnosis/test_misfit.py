"""Laws of the test on the size of the error."""

import numpy as np

from plop.diagnosis.scores.calibration import chance as share_of
from plop.diagnosis.scores.calibration import ways_to_deal
from plop.diagnosis.scores.misfit import differences, misfits, outlying
from plop.statistics.heavy_tails import FREEDOM

HERE = np.repeat([True, False], 6)
KINDS = ["push", "press"] * 6
WAYS = ways_to_deal(HERE, KINDS, 100)


def chance_of(found: np.ndarray, ways: np.ndarray = WAYS) -> float:
    """Chance that the recordings are explained less well by as much, as the search counts it."""
    apart = differences(found, ways, KINDS)
    return share_of(float(apart[0]), apart)


def chance(error: np.ndarray, noise: np.ndarray, seed: int) -> float:
    """Episodes with an error in proportion to the motion and noise, each of its own scale [E]."""
    random = np.random.default_rng(seed)
    motion = random.uniform(0.2, 1.0, (12, 400))
    residual = random.normal(size=(12, 400, 3)) * np.hypot(error[:, None] * motion, noise[:, None])[..., None]
    squares = (residual**2).sum(-1)
    found = misfits(list(squares), [np.full(400, n**2) for n in noise], list((3.0 * motion) ** 2), FREEDOM)
    return chance_of(found)


def scattered(mean: float, seed: int) -> np.ndarray:
    return mean * np.exp(np.random.default_rng([seed, 1]).normal(0, 0.3, 12))


def test_a_base_that_is_hardly_off_raises_no_alarm_by_noise():
    """The recordings have 1.4 times the noise of the reference: every 20th chance may be below 5 %, not most."""
    noise = np.where(HERE, 2**0.5, 1.0)
    found = np.array([chance(scattered(0.05, seed), noise, seed) for seed in range(120)])
    assert (found <= 0.05).mean() <= 0.12
    assert np.median(found) > 0.35


def test_an_error_twice_as_large_is_seen_nearly_as_often_as_if_scales_were_known():
    larger = np.where(HERE, 2.0, 1.0)
    errors = [scattered(3.0, seed) * larger for seed in range(60)]
    found = np.mean([chance(error, np.ones(12), seed) <= 0.01 for seed, error in enumerate(errors)])
    known = np.mean([chance_of(np.log(error)) <= 0.01 for error in errors])
    assert found >= 0.9 * known > 0.6


def test_motions_that_are_far_less_well_explained_raise_no_more_alarms():
    """Two pushes in four are off by far, whoever recorded them: 1 in 6 ways has both among the recordings."""
    found = np.array([3.19, 2.02, 1.18, 2.03, 3.06, 1.72, 1.28, 1.98, 1.6, 1.55, 1.8, 1.85])
    kinds = ["push", "press"] * 4 + ["drag"] * 4
    here = np.array([True, True, False, False] * 2 + [True, True, False, False])
    ways = ways_to_deal(here, kinds, 100)
    apart = differences(found, ways, kinds)
    assert np.mean([share_of(one, np.concatenate([[one], apart])) <= 0.01 for one in apart]) <= 0.01


def test_one_recording_that_differs_is_named_and_seldom_another():
    """1 % of sets may name one by chance; an episode ten times as far off is found among five others of its kind."""
    right = [outlying(np.log(scattered(1.0, seed)), HERE, KINDS, 0.01) for seed in range(300)]
    assert np.mean([bool(each) for each in right]) <= 0.03
    strange = np.where(np.arange(12) == 2, 10.0, 1.0)
    found = [outlying(np.log(scattered(1.0, seed) * strange), HERE, KINDS, 0.01) for seed in range(100)]
    assert np.mean([each == [2] for each in found]) > 0.6
    assert outlying(np.log(scattered(1.0, 0) * strange[::-1]), HERE, KINDS, 0.01) == []  # the reference is not judged
