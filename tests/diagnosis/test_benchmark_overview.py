import json
from pathlib import Path

import pytest

from benchmarks.goals import ShareGoal
from benchmarks.physics_overview import overview
from benchmarks.physics_tables import verdict_rates, wilson

DOCS = Path(__file__).resolve().parents[2] / "docs"


LEAST, MOST, BETWEEN = ShareGoal(0.9), ShareGoal(high=0.02), ShareGoal(0.9, 0.98)


@pytest.mark.parametrize("value, goal, said", [
    (0.9, LEAST, "yes"), (0.89, LEAST, "**no**"), (0.0, MOST, "yes"), (0.03, MOST, "**no**"),
    (0.875, BETWEEN, "**no**"), (0.95, BETWEEN, "yes"), (1.0, BETWEEN, "**no**"), (None, LEAST, "not run"),
])  # fmt: skip
def test_a_goal_is_reached_or_not(value, goal, said):
    assert goal.reached(value) == said


def test_goals_read_as_in_the_tables():
    assert [str(goal) for goal in (LEAST, MOST, BETWEEN)] == [">= 90 %", "<= 2 %", "90 to 98 %"]


def test_both_benchmarks_stand_beside_the_goals():
    points, cameras = verdict_rates([]), verdict_rates([])
    points["null"]["false_alarm"] = wilson(1, 4)
    cameras["parameter_error"]["median"] = 0.08
    lines = overview(points, cameras).splitlines()
    null = next(line for line in lines if line.startswith("| nothing hidden"))
    assert null.endswith("| <= 2 % | 25 % (5 to 70 %, n = 4) | **no** | not run | not run |")
    assert "| median error of the parameter | <= 10 % | not run | not run | 8 % | yes |" in lines


def test_the_page_shows_what_the_results_hold():
    points, cameras = (json.loads((DOCS / "results" / f"{name}.json").read_text())["sets"]
                       for name in ("physics", "physics_cameras"))  # fmt: skip
    assert overview(points, cameras) in (DOCS / "results-physics.md").read_text()
