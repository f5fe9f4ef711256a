"""A number from declaration to report: what is determined, by one rule; in and out of JSON; in words."""

from __future__ import annotations

import json
from math import inf

import numpy as np
import pytest

from plop.parameters import Estimate, Parameter, estimate_text
from plop.physics.calibration.material_parameters import PARAMETERS
from plop.physics.effects.library import library
from plop.physics.engine.material import Material

FRICTION, STIFFNESS = PARAMETERS["table_friction"], PARAMETERS["youngs_modulus_pa"]
TRACTION = Parameter("traction_pa", "Pa", 0, 1e5, 20)
TOUGHNESS, CHANGE = Parameter("d_j_m2", "J/m^2", -1000, 1000, 5), Parameter("d_ln_e", "-", -3, 3, 0.05)


@pytest.mark.parametrize(
    ("parameter", "found", "known"),
    [
        (FRICTION, Estimate(1, 0.35, 0.49), True),
        (FRICTION, Estimate(1, 0.0, 0.9), True),
        (FRICTION, Estimate(1, 0.0, 1.55), False),
        (FRICTION, Estimate(1, 0.35, 0.49, at_bound=True), False),
        (STIFFNESS, Estimate(1e4, 1e4, 1.7e4), True),
        (STIFFNESS, Estimate(1e4, 1e4, 1.5e5), False),
        (STIFFNESS, Estimate(1e4), False),
        (TRACTION, Estimate(300, 184, 1500), True),
        (TRACTION, Estimate(300, 184, 7890), False),
        (TRACTION, Estimate(50, 0, 100), True),  # hardly there, which is a result
        (TRACTION, Estimate(50, 1e-6, 100), True),  # the same
        (TOUGHNESS, Estimate(-200, -400, -30), False),
        (TOUGHNESS, Estimate(-60, -90, -30), True),
        (TOUGHNESS, Estimate(5, -20, 30), True),
        (CHANGE, Estimate(0, -0.4, 0.5), True),
        (CHANGE, Estimate(0, -1.4, 1.5), False),
        (None, Estimate(1, 1, 2), True),
        (None, Estimate(1, 1, inf), False),
    ],
)
def test_what_is_determined(parameter, found, known):
    judged = found.within(parameter)
    assert judged.determined == known
    assert Estimate.from_json(json.loads(json.dumps(judged.to_json(), allow_nan=False))) == judged or not known


@pytest.mark.parametrize(
    ("alternatives", "tried", "known"),
    [((0.03, 0.3), 3, False), ((), 3, True), ((45.0,), 4, True), ((45.0,), 0, False)],
)
def test_a_setting_is_determined_where_few_others_do_as_well(alternatives, tried, known):
    judged = Estimate(0.1, unit="s", alternatives=alternatives, fitted=False).within(FRICTION, tried)
    assert judged.determined == known and Estimate.from_json(judged.to_json()) == judged


def test_what_was_given_is_determined_and_stays_so_in_a_file():
    given = Estimate(40.0, unit="Pa s", fitted=False)
    assert given.determined and Estimate.from_json(given.to_json()).determined
    assert Estimate.from_json({"value": 40.0, "low": None, "high": None, "unit": "Pa s"}).determined


def test_in_a_file_no_number_is_infinite():
    found = Estimate(2.0, unit="Pa").to_json()
    assert found == {"value": 2.0, "low": None, "high": None, "unit": "Pa", "at_bound": False, "determined": False}


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (Estimate(2.0, 1.5, 2.5, "Pa"), "k = 2 (1.5 to 2.5) Pa"),
        (Estimate(2.0, high=3.0, unit="Pa"), "k = 2 Pa"),
        (Estimate(0.1, unit="s", alternatives=(0.03, 0.3), fitted=False), "k = 0.1 (or 0.03, 0.3) s"),
        (Estimate(0.5, 0.4, 0.6, "-"), "k = 0.5 (0.4 to 0.6)"),
    ],
)
def test_an_estimate_in_words(found, words):
    assert estimate_text("k", found) == words


def test_every_parameter_of_the_material_is_declared_with_its_default_and_source():
    for name, parameter in PARAMETERS.items():
        assert parameter.default == getattr(Material(), name) and parameter.source and parameter.unit
        assert parameter.low < parameter.high


def test_a_coordinate_of_a_fit_comes_back_inside_the_range():
    for parameter in (*PARAMETERS.values(), *(p for kind in library(()).values() for p in kind.parameters())):
        for share in (0.1, 0.5, 0.9):
            value = parameter.low + share * (parameter.high - parameter.low)
            assert parameter.decode(parameter.encode(value)) == pytest.approx(value)
        assert parameter.low <= parameter.decode(-1e9) <= parameter.high
    assert STIFFNESS.encode(np.e * 1e4) - STIFFNESS.encode(1e4) == pytest.approx(1)


def test_a_typical_value_outside_its_range_is_refused():
    with pytest.raises(ValueError, match="k: 5 is not in its range, 0 to 1"):
        Parameter("k", "-", 0, 1, 0.1, typical=5)


def test_the_models_own_error_widens_an_interval_on_the_scale_of_the_fit():
    found = Estimate(1e4, 0.8e4, 1.25e4).with_model_error(STIFFNESS)
    half = np.hypot(np.log(1.25), 1.96 * STIFFNESS.model_error)
    assert [found.low, found.high] == pytest.approx([1e4 * np.exp(-half), 1e4 * np.exp(half)], rel=1e-6)
    certain = Estimate(0.4, 0.4, 0.4).with_model_error(FRICTION)
    half = 1.96 * FRICTION.model_error
    assert [certain.low, certain.high] == pytest.approx([0.4 - half, 0.4 + half])
    unknown = Estimate(0.4)
    assert unknown.with_model_error(FRICTION) == unknown, "what is not known stays so"
    assert Estimate(1e4, 5e3, 4.6e4).within(STIFFNESS).determined
    assert not Estimate(1e4, 5e3, 4.6e4).with_model_error(STIFFNESS).determined, "judged again by its width"
