import json
from pathlib import Path

import pytest

from benchmarks.physics_overview import overview, reached
from benchmarks.physics_tables import verdict_rates, wilson

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.parametrize("value, goal, said", [
    (0.9, ">= 90 %", "yes"), (0.89, ">= 90 %", "**no**"), (0.0, "<= 2 %", "yes"), (0.03, "<= 2 %", "**no**"),
    (0.875, "90 to 98 %", "**no**"), (0.95, "90 to 98 %", "yes"), (1.0, "90 to 98 %", "**no**"),
    (None, ">= 90 %", "not run"),
])  # fmt: skip
def test_a_goal_is_reached_or_not(value, goal, said):
    assert reached(value, goal) == said


def test_both_benchmarks_stand_beside_the_goals():
    points, cameras = verdict_rates([]), verdict_rates([])
    points["null"]["false_alarm"] = wilson(1, 4)
    cameras["parameter_error"]["median"] = 0.08
    lines = overview(points, cameras).splitlines()
    null = next(line for line in lines if line.startswith("| nothing hidden"))
    assert null.endswith("| <= 2 % | 25 % (5 to 70 %, n = 4) | **no** | not run | not run |")
    assert lines[-2] == "| median error of the parameter | <= 10 % | not run | not run | 8 % | yes |"


def test_the_page_shows_what_the_results_hold():
    points, cameras = (json.loads((DOCS / "results" / f"{name}.json").read_text())["sets"]
                       for name in ("physics", "physics_cameras"))  # fmt: skip
    assert overview(points, cameras) in (DOCS / "results-physics.md").read_text()
