"""The sentences of a verdict."""

from __future__ import annotations

import numpy as np
import pytest

from plop.diagnosis.contrast import Contrast
from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.finding import Finding
from plop.diagnosis.verdict_text import base_text, parameters_text
from plop.parameters import Estimate

CLEAR = Contrast(8.0, 0.001, np.array([0.1]), np.zeros(1))


def finding(name: str, parameters: dict[str, Estimate]) -> Finding:
    return Finding(name, "base", parameters, gain=0.6, gain_error=0.05, p=0.005, contrast=CLEAR)


def test_an_infinite_interval_is_left_out_of_the_sentence():
    assert parameters_text(finding("tilt", {"e": Estimate(2.0, unit="Pa")})) == "e = 2 Pa"


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (-1.05, -0.43, "stiffness x 0.456 (0.35 to 0.651), d_ln_e = -0.785 (-1.05 to -0.43)"),
        (-np.inf, np.inf, "stiffness x 0.456, d_ln_e = -0.785"),
    ],
)
def test_a_changed_base_parameter_is_named_with_its_factor(low, high, shown):
    assert shown in base_text(finding("stiffness", {"d_ln_e": Estimate(-0.785, low, high, "-")}))


def test_a_base_parameter_without_a_logarithm_has_no_factor():
    text = base_text(finding("damping", {"d_per_s": Estimate(179.0, 62.4, 373.0, "1/s")}))
    assert text == "No law is missing; a parameter of the base differs: damping, d_per_s = 179 (62.4 to 373) 1/s."


def test_a_parameter_that_leaves_more_than_the_reference_shows_is_not_told_to_be_all():
    """Much is closed, but what is left stands out: nobody knows whether a law is missing."""
    stiffness = finding("stiffness", {"d_ln_e": Estimate(-1.0, -1.5, -0.5, "-")})
    far, near = (ErrorSize(error, 12.0, 1.0, excess, p) for error, excess, p in ((4.0, 5.0, 0.001), (1.2, 0.5, 0.4)))
    assert base_text(stiffness, [], near).startswith("No law is missing; ")
    told = base_text(stiffness, ["density"], far)
    assert "No law is missing" not in told and "closes 73 % of the explainable gap" in told
    assert "4 times the reference" in told and told.endswith("A change of density would explain as much.")
