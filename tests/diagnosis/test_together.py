"""Amplitudes that act together are found where those of each alone, added up, point elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from plop.diagnosis.candidates import Column
from plop.diagnosis.together import least_together, looked_around

TRUTH = np.array([3.2, -0.9])


def columns(limit: float = 5.0) -> tuple[Column, Column]:
    return tuple(Column("law", name, "-", (), 1.0, -limit, limit) for name in "xy")  # type: ignore[return-value]


def slides(place: np.ndarray) -> np.ndarray:
    """Lies still until the pull is strong enough, and then slides along it, ever faster."""
    pull = np.linalg.norm(place)
    return place / pull * max(pull - 1.5, 0.1 * pull) ** 1.5 if pull else np.zeros(2)


def left(unstable_from: float = np.inf, ran: list[np.ndarray] | None = None):
    def measure(wanted):
        found = []
        for settings in wanted:
            place = np.array([value for _, value in settings])
            if ran is not None:
                ran.append(place)
            off = np.concatenate([slides(place) - slides(TRUTH), [0.1]])
            found.append(None if np.linalg.norm(place) >= unstable_from else off)
        return found

    return measure


@pytest.mark.parametrize("start", [(2.2, 0.8), (4.9, -1.2), (0.6, 0.6)])
def test_the_least_is_found_from_a_start_that_points_elsewhere(start):
    np.testing.assert_allclose(least_together(columns(), np.array(start), left()), TRUTH, atol=0.05)


def test_the_best_of_several_starts_begins_the_search():
    ran: list[np.ndarray] = []
    away = np.array([-3.0, -3.0])
    begun = least_together(columns(), away, left(ran=ran), [np.array([2.9, -0.8]), np.array([9.0, 9.0])])
    np.testing.assert_allclose(begun, TRUTH, atol=0.05)
    assert not any(np.allclose(place, [9.0, 9.0]) for place in ran)  # its range is kept
    steps = [place for place in ran if np.linalg.norm(place - TRUTH) < 1]
    assert len(steps) > 3 and len(ran) < 40


def test_the_range_is_kept_and_nothing_is_run_twice():
    ran: list[np.ndarray] = []
    found = least_together(columns(2.0), np.array([9.0, -0.5]), left(ran=ran))
    assert np.abs(ran).max() <= 2.0 and found[0] == pytest.approx(2.0, abs=0.02)
    assert len(ran) == len({tuple(place) for place in ran})


def test_amplitudes_at_which_the_engine_is_unstable_are_kept_away_from():
    found = least_together(columns(), np.array([4.9, -1.2]), left(unstable_from=3.6))
    np.testing.assert_allclose(found, TRUTH, atol=0.05)
    found = least_together(columns(), np.array([4.9, -1.2]), left(unstable_from=3.0))
    assert np.linalg.norm(found) < 3.0 and found[0] > 2.5
    start = np.array([4.9, -1.2])
    np.testing.assert_array_equal(least_together(columns(), start, left(unstable_from=0.1)), start)


@pytest.mark.parametrize("truth", [(3.2, -0.9), (-0.9, -3.4), (0.1, 2.5)])
def test_the_direction_need_not_be_known(truth):
    def measure(wanted):
        places = [np.array([value for _, value in settings]) for settings in wanted]
        return [np.concatenate([slides(place) - slides(np.array(truth)), [0.1]]) for place in places]

    found = looked_around(columns(), measure)
    np.testing.assert_allclose(found, truth, atol=0.1)


def test_a_law_that_helps_in_no_direction_is_not_searched():
    ran: list[np.ndarray] = []

    def measure(wanted):
        ran.extend(wanted)
        return [np.array([1.0, *(value for _, value in settings)]) for settings in wanted]

    assert looked_around(columns(), measure) is None
    assert len(ran) == 1 + 8
    three = (*columns(), Column("law", "z", "-", (), 1.0, 0.0, 5.0))
    ran.clear()
    assert looked_around(three, measure) is None
    assert len(ran) == 6  # nothing and six directions, of which one leaves the range and is nothing again
