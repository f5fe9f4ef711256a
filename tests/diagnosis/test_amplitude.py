"""Intervals of amplitudes tell what is not known."""

from __future__ import annotations

import numpy as np
import pytest

from plop.diagnosis.amplitude import RESPONSE_ERROR, amplitude_of
from plop.diagnosis.candidates import Column
from plop.diagnosis.profile import Profile

FIBRES = Column("fibres", "ratio", "-", (), 2.0, 0.0, 20.0)
SWELLING = Column("swelling", "rate_per_s", "1/s", (), 0.1, -1.0, 1.0)


def power_law(power: float, amplitudes: np.ndarray, truth: float = 2.1) -> Profile:
    """Give the profile of a law whose response is amplitude^power; the error is least at the truth."""
    size = np.abs(amplitudes) ** power
    return Profile(amplitudes, (size - truth**power) ** 2, size)


def test_a_proportional_law_is_known_as_well_as_the_engine_responds():
    found = amplitude_of(SWELLING, 0.12, 0.0, freedom=7)
    assert (found.low, found.high) == pytest.approx(
        (0.12 * (1 - 1.96 * RESPONSE_ERROR), 0.12 * (1 + 1.96 * RESPONSE_ERROR)), rel=1e-3
    )
    negative = amplitude_of(SWELLING, -0.12, 0.0, freedom=7)
    assert (negative.low, negative.high) == pytest.approx((-found.high, -found.low))


def test_scatter_between_episodes_adds_to_it():
    calm, rough = (amplitude_of(SWELLING, 0.12, error, freedom=7) for error in (0.001, 0.03))
    assert rough.low < calm.low < 0.12 < calm.high < rough.high
    unclear = amplitude_of(SWELLING, 0.01, 0.03, freedom=7)
    assert unclear.low < 0 < unclear.high


@pytest.mark.parametrize("power", [0.3, 1.0])
def test_a_law_that_saturates_leaves_its_amplitude_open(power: float):
    found = amplitude_of(FIBRES, 2.1, 0.0, 7, power_law(power, np.array([1.0, 2.0, 4.0])))
    assert found.high == pytest.approx(min(2.1 * (1 + 1.96 * RESPONSE_ERROR) ** (1 / power), 20.0), rel=0.01)
    assert found.low == pytest.approx(2.1 * (1 - 1.96 * RESPONSE_ERROR) ** (1 / power), rel=0.01)


def test_a_steep_response_tells_an_amplitude_no_better_than_a_proportional_one():
    steep, straight = (
        amplitude_of(FIBRES, 2.1, 0.0, 7, power_law(power, np.array([1.0, 2.0, 4.0]))) for power in (2.0, 1.0)
    )
    assert (steep.low, steep.high) == pytest.approx((straight.low, straight.high), rel=0.01)
    unsteady = amplitude_of(FIBRES, 2.1, 2.1, 7, power_law(2.0, np.array([1.0, 2.0, 4.0])))
    assert unsteady.low < steep.low and unsteady.high > steep.high


def test_a_response_that_no_longer_grows_has_no_upper_end():
    flat = Profile(np.array([1.0, 2.0, 4.0]), np.array([3.0, 1.0, 1.1]), np.array([1.0, 1.01, 1.01]))
    assert amplitude_of(FIBRES, 2.1, 0.0, 7, flat).high == FIBRES.high


def test_what_cannot_be_told_has_an_infinite_interval():
    found = amplitude_of(SWELLING, 0.1, float("inf"), freedom=7)
    assert found.low == -np.inf and found.high == np.inf


def test_a_value_at_the_end_of_its_range_says_so():
    assert amplitude_of(FIBRES, 25.0, 0.1, freedom=7).at_bound
    assert not amplitude_of(FIBRES, 2.1, 0.1, freedom=7).at_bound
