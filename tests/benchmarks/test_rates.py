"""Rates of the third edition: what counts as right, and what is shown by an interval."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.missing_physics.rates import rates_of, rivals_of


def row(group: str, law: str, kind: str, *named: str, value: float = 1.0, **more: Any) -> dict[str, Any]:
    parameters = {"a": {"value": value, "low": 0.5, "high": 2.0}}
    verdict = {"kind": kind, "named": list(named), "evidence": {"closed": 0.9}}
    ranking = [{"effect": named[0] if named else "tilt", "parameters": parameters}]
    return {
        "group": group,
        "law": law,
        "said": {"reference": {"verdict": verdict, "ranking": ranking}},
        "truth": {law: {"a": 1.0}},
        "rivals": {"bic": list(named), "sparse": [], "correlation": ["tilt"]},
        **more,
    }


def test_a_null_is_alarmed_by_whatever_is_said_of_it():
    rows = [row("null", "", "NOTHING DETECTABLE") for _ in range(148)] + [row("null", "", "NONE OF THESE")]
    rate = rates_of(rows, "reference")["null_false_alarm"]
    assert rate["rate"] == pytest.approx(1 / 149) and rate["n"] == 149 and not rate["shown"]
    clean = rates_of(rows[:-1] + rows[:1], "reference")["null_false_alarm"]
    assert clean["rate"] == 0 and clean["shown"]  # 149 without one show 2 %


def test_ways_of_one_null_count_as_one_set():
    rows = [row("null", "", "NOTHING DETECTABLE", dealt=[k == 0] * 20) for k in range(4)]
    rate = rates_of(rows, "reference")["dealt_false_alarm"]
    assert rate["rate"] == 0.25 and rate["n"] == 4 and rate["ways"] == 80 and rate["high"] > 0.9 and not rate["shown"]


def test_singles_pairs_and_laws_outside_the_library():
    rows = [
        row("single", "swelling", "EFFECT", "swelling", value=1.2),
        row("single", "tilt", "EFFECT", "swelling", value=5.0),
        row("single", "viscosity", "NOTHING DETECTABLE"),
        row("single", "stiffness", "BASE PARAMETER", "stiffness"),
        row("outside", "tilt", "NONE OF THESE"),
        row("outside", "tilt", "EFFECT", "adhesion"),
        row("pair", "tilt+swelling", "EFFECT", "swelling", "tilt"),
        row("pair", "tilt+swelling", "EFFECT", "swelling"),
        row("single below", "tilt", "EFFECT", "drag"),
    ]
    found = rates_of(rows, "reference")
    assert found["single_named_first"]["rate"] == pytest.approx(1 / 3) and found["single_named_first"]["n"] == 3
    assert found["single_wrong_name"]["rate"] == pytest.approx(1 / 3)
    assert found["base_parameter_named"]["rate"] == 1 and found["outside_none_or_partly"]["rate"] == 0.5
    assert found["pairs_both"]["rate"] == 0.5 and found["decoy_named"]["rate"] == pytest.approx(1 / 9)
    assert found["parameter_error"]["median"] == pytest.approx(0.1) and found["interval_coverage"]["rate"] == 1
    assert found["difference_closed"]["median"] == pytest.approx(0.45)  # a miss closes nothing
    assert rivals_of(rows)["bic"]["single_named_first"] == {"rate": 0.5, "n": 4}


def test_a_base_counts_once_however_many_sets_it_has():
    estimates = {"table_friction": {"low": 0.3, "high": 0.5}, "tool_friction": {"low": None, "high": 0.5}}
    base = {"declared": {"table_friction": 0.6, "tool_friction": 0.4}, "estimates": estimates}
    rows = [row("null", "", "NOTHING DETECTABLE", base=base, world="drake", seed=1) for _ in range(3)]
    rate = rates_of(rows, "reference")["base_interval_coverage"]
    assert rate["rate"] == 0.5 and rate["n"] == 2


def test_without_a_set_nothing_is_a_rate():
    found = rates_of([], "reference")
    assert found["null_false_alarm"] == {"rate": None, "low": None, "high": None, "n": 0, "shown": False}
    assert found["dealt_false_alarm"]["n"] == 0
