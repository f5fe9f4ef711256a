"""The least error over an amplitude is found, wherever the search starts, and never outside the range."""

from __future__ import annotations

import numpy as np
import pytest

from plop.diagnosis.candidates import Column
from plop.diagnosis.profile import CLOSER, Profile, profiles_of


def column(start: float, low: float = 0.0, high: float = 100.0) -> Column:
    return Column("law", "a", "-", (), start, low, high)


def measured(truth: float, power: float, tried: list[float], unstable_from: float = np.inf):
    """Runs of a law whose response is |a|^power in the direction of a's sign."""

    def measure(wanted):
        tried.extend(a for _, a in wanted)
        return [
            None
            if abs(a) >= unstable_from
            else ((np.sign(a) * abs(a) ** power - np.sign(truth) * abs(truth) ** power) ** 2, abs(a) ** power)
            for _, a in wanted
        ]

    return measure


@pytest.mark.parametrize("start", [0.5, 3.0, 20.0])
@pytest.mark.parametrize("power", [0.5, 1.0])
def test_the_least_is_found_from_afar(start: float, power: float):
    found = profiles_of([column(start)], measured(3.0, power, []))["law().a"]
    assert found.least() == pytest.approx(3.0, rel=0.02)


def test_negative_amplitudes_are_searched_too():
    found = profiles_of([column(-1.0, low=-10.0)], measured(-3.0, 1.0, []))["law().a"]
    assert found.least() == pytest.approx(-3.0, rel=0.02)
    assert found.at_response(-2.0, 2.0) == pytest.approx(-4.0, rel=0.01)


def test_the_range_is_kept_and_nothing_is_run_twice():
    tried: list[float] = []
    found = profiles_of([column(1.5, high=2.0)], measured(50.0, 1.0, tried))["law().a"]
    assert found.least() == 2.0
    assert max(tried) == 2.0 and len(tried) == len(set(tried))


def test_unstable_amplitudes_are_left_out():
    found = profiles_of([column(2.0)], measured(3.0, 1.0, [], unstable_from=2.5))["law().a"]
    assert found.least() == 2.0 and found.amplitudes.max() == 2.0
    assert profiles_of([column(2.0)], measured(3.0, 1.0, [], unstable_from=0.1)) == {}


def test_one_run_alone_is_taken_as_proportional():
    assert Profile(np.array([2.0]), np.array([1.0]), np.array([1.0])).at_response(2.0, 1.5) == 3.0


def test_the_engine_is_run_again_where_the_least_should_be():
    """What slides beyond a threshold responds ever more: a parabola over the threshold has its vertex too far."""
    tried: list[float] = []

    def measure(wanted):
        tried.extend(a for _, a in wanted)
        return [((a - 5) ** 2, a) if a < 5 else (3.3 * (a - 5) ** 2, 5 + 18 * (a - 5)) for _, a in wanted]

    found = profiles_of([column(2.0)], measure)["law().a"]
    once = Profile(*np.array([(a, *measure([(None, a)])[0]) for a in (2.0, 4.0, 8.0)]).T)
    assert once.least() > 5.5 and found.least() == pytest.approx(5.0, rel=0.05)
    assert 4 < len(found.amplitudes) <= 4 + CLOSER


@pytest.mark.parametrize("truth", [0.8, 0.85, 0.9])
def test_near_an_end_at_which_the_response_grows_without_bounds_the_least_is_found(truth: float):
    """A share that relaxes: what is left of the stiffness vanishes at the end, and the direction changes on the way."""

    def response(a: float) -> np.ndarray:
        return np.array([2 * a, 0.02 * (a / (1 - a)) ** 2])

    def measure(wanted):
        return [
            (float(((response(a) - response(truth)) ** 2).sum()), float(np.linalg.norm(response(a)))) for _, a in wanted
        ]

    found = profiles_of([column(0.95, high=0.95)], measure)["law().a"]
    assert found.least() == pytest.approx(truth, rel=0.03)


def test_at_the_end_of_the_range_the_least_may_lie_before_it():
    found = profiles_of([column(100.0)], measured(80.0, 1.0, []))["law().a"]
    assert found.least() == pytest.approx(80.0, rel=0.02)
