"""Intervals of amplitudes tell what is not known."""

from __future__ import annotations

import numpy as np
import pytest

from plop.diagnosis.amplitude import GROWTH_LIMITS, RESPONSE_ERROR, amplitude_of, growth_of
from plop.diagnosis.candidates import Column

FIBRES = Column("fibres", "ratio", "-", (), 2.0, 0.0, 20.0)
SWELLING = Column("swelling", "rate_per_s", "1/s", (), 0.1, -1.0, 1.0)


@pytest.mark.parametrize("power", [0.3, 1.0, 1.5])
def test_the_exponent_of_a_power_law_is_found(power: float):
    shape = np.random.default_rng(0).normal(size=(5, 7, 3))
    full, half = [shape, 2 * shape], [0.5**power * shape, 2 * 0.5**power * shape]
    assert growth_of(full, half) == pytest.approx(power)


def test_exponents_stay_within_limits():
    shape = np.ones((4, 3))
    assert growth_of([shape], [shape]) == GROWTH_LIMITS[0]
    assert growth_of([shape], [0 * shape]) == GROWTH_LIMITS[1]
    assert growth_of([0 * shape], [shape]) == GROWTH_LIMITS[0]


def test_a_proportional_law_is_known_as_well_as_the_engine_responds():
    found = amplitude_of(SWELLING, 0.12, 0.0, episodes=8)
    assert (found["low"], found["high"]) == pytest.approx((0.12 * (1 - 1.96 * RESPONSE_ERROR),
                                                           0.12 * (1 + 1.96 * RESPONSE_ERROR)), rel=1e-3)  # fmt: skip
    negative = amplitude_of(SWELLING, -0.12, 0.0, episodes=8)
    assert (negative["low"], negative["high"]) == pytest.approx((-found["high"], -found["low"]))


def test_scatter_between_episodes_adds_to_it():
    calm, rough = (amplitude_of(SWELLING, 0.12, error, episodes=8) for error in (0.001, 0.03))
    assert rough["low"] < calm["low"] < 0.12 < calm["high"] < rough["high"]
    unclear = amplitude_of(SWELLING, 0.01, 0.03, episodes=8)
    assert unclear["low"] < 0 < unclear["high"]


def test_a_law_that_saturates_leaves_its_amplitude_open():
    free, saturated = (amplitude_of(FIBRES, 2.1, 0.1, episodes=8, growth=p) for p in (1.0, 0.3))
    assert saturated["low"] < free["low"] and saturated["high"] > 2 * free["high"]
    assert amplitude_of(FIBRES, 2.1, 0.1, episodes=8, growth=0.1)["high"] == FIBRES.high


def test_what_cannot_be_told_has_an_infinite_interval():
    found = amplitude_of(SWELLING, 0.1, float("inf"), episodes=8)
    assert found["low"] == -np.inf and found["high"] == np.inf


def test_a_value_at_the_end_of_its_range_says_so():
    assert amplitude_of(FIBRES, 25.0, 0.1, episodes=8)["at_bound"]
    assert not amplitude_of(FIBRES, 2.1, 0.1, episodes=8)["at_bound"]
