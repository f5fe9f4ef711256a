"""The missing-physics benchmarks count what they say, and go on where they stopped."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest

from benchmarks.missing_physics import __main__ as command
from benchmarks.missing_physics.plan import points_plan
from benchmarks.missing_physics.row import Group, Row
from benchmarks.missing_physics.runner import go_on, is_judged, newest_rows, shared, stored_rows
from benchmarks.missing_physics.score import Goal, confusion, other_rates, overview, verdict_rates, wilson
from benchmarks.missing_physics.tables import rates_table, runs_table
from stages.diagnose.stage import STAGE

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"
TILT = {"tilt": {"gx_m_s2": 1.0}}


def row(name: str, **changes: Any) -> Row:
    kept = {
        "name": name,
        "set": name.split("-")[0],
        "seed": 1,
        "hidden": {},
        "rms_mm": 1.0,
        "snr": 2.0,
        "verdict": "EFFECT",
        "named": ["tilt"],
        "ranks": [1],
        "error": 5.0,
        "floor": 1.0,
        "left": 2.0,
        "parameters": {"tilt": {"gx_m_s2": {"value": 1.1, "low": 0.9, "high": 1.3}}},
        "baselines": {"bic": ["tilt"], "sparse": ["drag"], "residual_error_share": 0.5},
    }
    return Row.from_json({**kept, **changes})


def rows() -> list[Row]:
    return [
        row("single-a", hidden=TILT),
        row("single-b", hidden=TILT, named=["drag"]),
        row("single-faint", hidden=TILT, snr=0.5, verdict="NOTHING DETECTABLE", named=[]),
        row("null-0", verdict="NOTHING DETECTABLE", named=[]),
        row("null-1"),
        row("pair-a", hidden={**TILT, "swelling": {"rate_per_s": 0.1}}),
        row("outside-a", hidden=TILT, verdict="PARTLY", named=["fibres"]),
    ]


def test_rates_count_the_right_runs():
    found = verdict_rates(rows())
    assert found["single"]["top1"]["n"] == 2 and found["single"]["top1"]["rate"] == 0.5
    assert found["single"]["from_snr_1_top1"]["n"] == 2
    assert found["single"]["all_amplitudes_top1"]["n"] == 3
    assert [found["recovery"][key]["n"] for key in ("snr_2_and_more", "snr_1_to_2", "snr_below_1")] == [2, 0, 1]
    assert found["single"]["wrong_name"]["rate"] == pytest.approx(1 / 3)
    assert found["null"]["false_alarm"]["rate"] == 0.5
    assert found["pairs"]["both"]["rate"] == 0 and found["pairs"]["one"]["rate"] == 1
    assert found["outside"]["none_or_partly"]["rate"] == 1
    assert found["decoys"]["chosen"]["rate"] == pytest.approx(1 / 7)
    assert found["parameter_error"]["median"] == pytest.approx(0.1) and found["parameter_error"]["covered"]["rate"] == 1
    assert found["gap_closed"]["median"] == pytest.approx(0.75)
    assert confusion(rows())["tilt"] == {"tilt": 1, "drag": 1, "nothing detectable": 1}


def test_other_methods_are_counted_where_they_were_asked():
    asked = row("single-s", hidden=TILT, baselines={**(rows()[0].baselines or {}), "sindy": [["drag"], ["tilt", "x"]]})
    found = other_rates([*rows(), asked])
    assert found["bic_first"] == wilson(3, 3) and found["sparse_first"] == wilson(0, 3), "faint ones left out"
    assert found["sindy_first"] == wilson(0, 1) and found["sindy_among"] == wilson(1, 1)
    assert found["bic_null_false_alarm"] == wilson(2, 2) and found["residual_error_share"] == 0.5


def test_the_best_of_the_wrong_laws_is_measured():
    alone = row("single-a", hidden=TILT, gains={"tilt": 0.75, "drag": 0.08, "swelling": 0.04, "stiffness": 0.3})
    worse = row("single-b", hidden=TILT, gains={"tilt": 0.7, "drag": -0.5})
    without_gap = row("single-c", hidden=TILT, error=1.05, gains={"drag": 0.5})
    without_names = row("single-d", hidden=TILT, gains=[0.7, 0.6])
    found = verdict_rates([alone, worse, without_gap, without_names])["wrong_law"]
    assert found == {"median": pytest.approx(0.05), "n": 2}  # 8 % of 5 are 10 % of 5 - 1; harm closes nothing


def test_the_second_of_two_may_be_named_after_the_first():
    both = {**TILT, "swelling": {"rate_per_s": 0.1}}
    pairs = [
        row("pair-a", hidden=both, next_named=["swelling"]),
        row("pair-b", hidden=both, next_named=[]),
        row("pair-c", hidden=both),
    ]
    found = verdict_rates(pairs)["pairs"]
    assert found["both"] == wilson(0, 3) and found["both_in_turn"] == wilson(1, 2)


def test_what_no_amplitude_makes_visible_is_shown_and_not_counted():
    faint = Row("snr4-tilt", Group.UNREACHABLE, 2, TILT, 0.3, "-")
    assert verdict_rates([*rows(), faint]) == verdict_rates(rows()) and confusion([faint]) == {}
    assert "| unreachable 2 | tilt: gx_m_s2 1 | - | 0.3 | - | - | - | - |" in runs_table([faint])


def test_wilson_knows_how_little_few_runs_say():
    assert wilson(0, 0)["rate"] is None
    none, few = wilson(0, 54), wilson(9, 10)
    assert none["low"] == pytest.approx(0)
    assert none["high"] == pytest.approx(0.0664, abs=1e-3)  # published tables of the interval
    assert few["low"] == pytest.approx(0.596, abs=2e-3) and few["high"] == pytest.approx(0.982, abs=2e-3)


LEAST, MOST, BETWEEN = Goal(0.9), Goal(high=0.02), Goal(0.9, 0.98)


@pytest.mark.parametrize(
    "value, goal, reached",
    [
        (0.9, LEAST, True),
        (0.89, LEAST, False),
        (0.0, MOST, True),
        (0.03, MOST, False),
        (0.875, BETWEEN, False),
        (0.95, BETWEEN, True),
        (1.0, BETWEEN, False),
        (None, LEAST, None),
    ],
)
def test_a_goal_is_reached_or_not(value, goal, reached):
    assert goal.reached(value) is reached


def test_both_benchmarks_stand_beside_the_goals():
    points, cameras = verdict_rates([]), verdict_rates([])
    cameras["null"]["false_alarm"] = wilson(1, 4)
    points["parameter_error"] |= {"median": 0.08, "n": 14}
    lines = rates_table({"cameras": cameras, "points": points}).splitlines()
    assert "| nothing hidden: something is named | <= 2 % | 25 % (5 to 70 %, n = 4), **missed** | not run |" in lines
    assert "| error of the amplitude, median | <= 10 % | not run | 8 % (n = 14) |" in lines
    assert [str(goal) for goal in (LEAST, MOST, BETWEEN)] == [">= 90 %", "<= 2 %", "90 to 98 %"]


def test_a_row_survives_its_file():
    kept = row("single-a", hidden=TILT, judged_by=27, parameters=None, amplitude_off=0.2, amplitude_held=[True])
    assert Row.from_json(json.loads(json.dumps(kept.to_json()))) == kept
    assert Row.from_json({**kept.to_json(), "limits_mm": {"tilt": 1.0}}) == kept, "what only older versions wrote"
    assert kept.amplitude() == (0.2, [True])


def test_scored_again_the_stored_rows_give_the_stored_rates(tmp_path: Path):
    for path in RESULTS.glob("*.json"):
        (tmp_path / path.name).write_text(path.read_text())
    command.score(command.parsed(["score", "--results", str(tmp_path), "--work", str(tmp_path / "none")]))
    for name in ("points", "cameras"):
        before, after = (json.loads((f / f"physics_{name}.json").read_text()) for f in (RESULTS, tmp_path))
        assert after["sets"] == before["sets"] and len(after["runs"]) == len(before["runs"]) > 0
    both = (json.loads((tmp_path / f"physics_{name}.json").read_text()) for name in ("cameras", "points"))
    found = overview(*both) | {"versions": None}
    assert found == json.loads((RESULTS / "physics.json").read_text()) | {"versions": None}


def test_a_folder_s_row_goes_before_the_stored_one_and_another_version_s_is_made_anew(tmp_path: Path):
    stored = {
        name: row(name, judged_by=version)
        for name, version in (("null-0", STAGE.version), ("null-1", STAGE.version - 1), ("null-2", STAGE.version - 1))
    }
    (tmp_path / "null-1.json").write_text(json.dumps(row("null-1", seed=7).to_json()))
    names = ["null-0", "null-1", "null-2", "null-3"]
    assert [is_judged(name, tmp_path, stored) for name in names] == [True, True, False, False]
    assert [each.seed for each in newest_rows(reversed(names), tmp_path, stored)] == [1, 7, 1]


def test_processes_share_the_plan_without_overlap():
    plan = points_plan()
    assert sorted(shared(plan, "1/2") + shared(plan, "2/2"), key=plan.index) == plan


class Noted:
    """A benchmark that takes a while and notes what it was asked for."""

    def __init__(self, work: Path, seconds: float = 0.0) -> None:
        self.work, self.plan, self.seconds = work, points_plan()[:4], seconds
        self.made: list[tuple[str, dict | None]] = []

    def prepare(self) -> None:
        (self.work / "prepared").touch()

    def carry_out(self, run, earlier):
        time.sleep(self.seconds)
        self.made.append((run.name, earlier and earlier.hidden))
        return Row(run.name, run.group, run.seed, {}, 1.0, "NOTHING DETECTABLE")


def test_a_stopped_benchmark_goes_on(tmp_path: Path, capsys):
    benchmark = Noted(tmp_path, seconds=0.2)
    names = [run.name for run in benchmark.plan]
    go_on(benchmark, benchmark.plan, {}, minutes=0.3 / 60)
    assert [name for name, _ in benchmark.made] == names[:2] and (tmp_path / "prepared").is_file()
    go_on(benchmark, benchmark.plan, {}, minutes=1)
    assert [name for name, _ in benchmark.made] == names, "none twice"
    kept = newest_rows(names, tmp_path / "rows", {})
    assert [each.judged_by for each in kept] == [STAGE.version] * 4 and all(each.seconds for each in kept)


def test_what_an_earlier_version_hid_is_handed_on_and_what_was_unreachable_is_not_tried(tmp_path: Path):
    benchmark = Noted(tmp_path)
    first, second, third, fourth = (run.name for run in benchmark.plan)
    stored = {
        first: row(first, set="single", hidden=TILT, judged_by=STAGE.version - 1),
        second: row(second, set="unreachable"),
        third: row(third, set="single", judged_by=STAGE.version),
    }
    go_on(benchmark, benchmark.plan, stored, minutes=1)
    assert benchmark.made == [(first, TILT), (fourth, None)]


def test_a_run_that_no_plan_holds_is_explained(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["-", "run", "points", "--only", "snr5-tilt", "--work", str(tmp_path)])
    assert command.main() == 1
    assert "The plan has no such run." in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_stored_rows_of_no_file_are_none(tmp_path: Path):
    assert stored_rows(tmp_path / "physics_points.json") == {}
