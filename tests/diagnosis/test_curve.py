"""The size of a law's response over its amplitude, and the amplitudes that belong to a response of some size."""

from __future__ import annotations

import numpy as np
import pytest

from plop.diagnosis.decision.finding import Curve


def test_a_response_in_proportion_gives_amplitudes_in_proportion():
    for curve in (Curve(), Curve(((0.5, 0.5), (1.0, 1.0), (2.0, 2.0)))):
        assert [curve.amplitude(size) for size in (-0.4, 0.3, 1.0, 1.6, 3.0)] == pytest.approx([-0.4, 0.3, 1, 1.6, 3])


def test_where_a_response_grows_slowly_larger_amplitudes_are_as_likely():
    curve = Curve(((0.5, 0.8), (1.0, 1.0), (2.0, 1.2)))
    assert curve.amplitude(1.1) == pytest.approx(1.5)
    assert curve.amplitude(1.5) == pytest.approx(3.5), "as the curve goes on beyond the last run"
    assert curve.amplitude(0.4) == pytest.approx(0.25)


def test_a_response_that_does_not_change_any_more_has_no_largest_amplitude():
    flat = Curve(((0.5, 0.9), (1.0, 1.0), (2.0, 0.98)))
    assert flat.amplitude(0.95) == pytest.approx(0.75)
    assert np.isinf(flat.amplitude(1.01))


def test_a_threshold_keeps_the_smallest_amplitude_above_it():
    """A friction that is overcome at half of the amplitude: less than that does nothing."""
    assert Curve(((0.5, 0.0), (1.0, 1.0))).amplitude(0.5) == pytest.approx(0.75)
