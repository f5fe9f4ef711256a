import json
from pathlib import Path

import pytest

from benchmarks.goals import ShareGoal
from benchmarks.physics_overview import facts_of, overview
from benchmarks.physics_tables import verdict_rates, wilson

DOCS = Path(__file__).resolve().parents[2] / "docs"


LEAST, MOST, BETWEEN = ShareGoal(0.9), ShareGoal(high=0.02), ShareGoal(0.9, 0.98)


@pytest.mark.parametrize(
    "value, goal, said",
    [
        (0.9, LEAST, "yes"),
        (0.89, LEAST, "**no**"),
        (0.0, MOST, "yes"),
        (0.03, MOST, "**no**"),
        (0.875, BETWEEN, "**no**"),
        (0.95, BETWEEN, "yes"),
        (1.0, BETWEEN, "**no**"),
        (None, LEAST, "not run"),
    ],
)
def test_a_goal_is_reached_or_not(value, goal, said):
    assert goal.reached(value) == said


def test_goals_read_as_in_the_tables():
    assert [str(goal) for goal in (LEAST, MOST, BETWEEN)] == [">= 90 %", "<= 2 %", "90 to 98 %"]


def test_both_benchmarks_stand_beside_the_goals():
    points, cameras = verdict_rates([]), verdict_rates([])
    cameras["null"]["false_alarm"] = wilson(1, 4)
    points["parameter_error"] |= {"median": 0.08, "n": 14}
    lines = overview(cameras, points).splitlines()
    null = next(line for line in lines if line.startswith("| nothing hidden"))
    assert null.endswith("| <= 2 % | 25 % (5 to 70 %, n = 4) | **no** | not run | not run |")
    assert "| median error of the parameter | <= 10 % | not run | not run | 8 % (n = 14) | yes |" in lines


def test_rates_of_single_laws_are_those_that_the_goals_speak_of():
    row = {
        "set": "single",
        "hidden": {"tilt": {"gx_m_s2": 1.0}},
        "verdict": "NOTHING DETECTABLE",
        "named": [],
        "ranks": [2],
        "error": 2.0,
        "floor": 1.0,
        "left": 1.5,
        "judged_by": 30,
    }
    named = {
        "verdict": "EFFECT",
        "named": ["tilt"],
        "parameters": {"tilt": {"gx_m_s2": {"value": 1.0, "low": 0.9, "high": 1.1}}},
    }
    runs = [row | {"snr": 1.5}, row | named | {"snr": 3.0}]
    result = {"versions": {}, "seeds": [1, 2], "sets": verdict_rates(runs), "runs": runs}
    points = result | {"sets": {**result["sets"], "baselines": {"bic_first": wilson(1, 1)}}}
    found = facts_of(result, points)
    assert found["sets"]["single"]["top1"] == wilson(1, 1) and found["sets"]["single"]["from_snr_1_top1"]["n"] == 2
    assert found["confusion"]["tilt"] == {"tilt": 1, "nothing detectable": 1} and found["judged_by"] == {"30": 2}
    assert found["sets"]["baselines"]["measured_on"] == "followed points"


def test_page_and_file_show_what_the_results_hold():
    cameras, points = (
        json.loads((DOCS / "results" / f"{name}.json").read_text()) for name in ("physics_cameras", "physics_points")
    )
    assert overview(cameras["sets"], points["sets"])
    assert facts_of(cameras, points) == json.loads((DOCS / "results" / "physics.json").read_text())
