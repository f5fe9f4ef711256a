"""The table of the missing-physics benchmark counts what it says."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import physics_points
from benchmarks.measure import plain_json
from benchmarks.newest import is_judged, newest_rows, shared, written_rows
from benchmarks.physics_plan import DEVELOPED, PLAN, REASONS
from benchmarks.physics_tables import confusion, summary, wilson, write_results
from plop.diagnosis.contrast import Contrast
from plop.diagnosis.finding import Finding
from stages.diagnose.stage import STAGE


def run(name: str, **changes: Any) -> dict[str, Any]:
    row = {
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
    return {**row, **changes}


TILT = {"tilt": {"gx_m_s2": 1.0}}


def rows() -> list[dict[str, Any]]:
    return [
        run("single-a", hidden=TILT),
        run("single-b", hidden=TILT, named=["drag"]),
        run("single-faint", hidden=TILT, snr=0.5, verdict="NOTHING DETECTABLE", named=[]),
        run("null-0", verdict="NOTHING DETECTABLE", named=[]),
        run("null-1"),
        run("pair-a", hidden={**TILT, "swelling": {"rate_per_s": 0.1}}),
        run("outside-a", hidden=TILT, verdict="PARTLY", named=["fibres"]),
    ]


def test_rates_count_the_right_runs():
    found = summary(rows())
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


def test_the_best_of_the_wrong_laws_is_measured():
    alone = run("single-a", hidden=TILT, gains={"tilt": 0.75, "drag": 0.08, "swelling": 0.04, "stiffness": 0.3})
    worse = run("single-b", hidden=TILT, gains={"tilt": 0.7, "drag": -0.5})
    without_gap = run("single-c", hidden=TILT, error=1.05, gains={"drag": 0.5})
    without_names = run("single-d", hidden=TILT, gains=[0.7, 0.6])
    found = summary([alone, worse, without_gap, without_names])["wrong_law"]
    assert found == {"median": pytest.approx(0.05), "n": 2}  # 8 % of 5 are 10 % of 5 - 1; harm closes nothing


def test_a_finding_is_kept_with_every_amplitude_of_its_contrast():
    contrast = Contrast(8.0, np.float64(0.001), np.array([0.1, np.inf]), np.zeros(2))
    kept = plain_json(asdict(Finding("tilt", "physics", {}, np.float32(0.5), 0.1, None, contrast)))
    assert kept["contrast"]["least"] == [0.1, None] and kept["gain"] == 0.5


def test_the_second_of_two_may_be_named_after_the_first():
    both = {**TILT, "swelling": {"rate_per_s": 0.1}}
    pairs = [
        run("pair-a", hidden=both, next_named=["swelling"]),
        run("pair-b", hidden=both, next_named=[]),
        run("pair-c", hidden=both),
    ]
    found = summary(pairs)["pairs"]
    assert found["both"] == wilson(0, 3) and found["both_in_turn"] == wilson(1, 2)


def test_what_no_amplitude_makes_visible_is_shown_and_not_counted(tmp_path: Path):
    faint = {
        "name": "snr4-tilt",
        "set": "unreachable",
        "seed": 2,
        "hidden": TILT,
        "snr": 0.3,
        "verdict": "-",
        "named": [],
    }
    assert summary([*rows(), faint]) == summary(rows()) and confusion([faint]) == {}
    page = tmp_path / "results-physics.md"
    page.write_text("<!-- runs:begin -->\n<!-- runs:end -->")
    write_results([faint], tmp_path, command="python -m benchmarks.physics_points")
    assert "| unreachable 2 | tilt: gx_m_s2 1 | - | 0.3 | - | - | - |" in page.read_text()


def test_wilson_knows_how_little_few_runs_say():
    assert wilson(0, 0)["rate"] is None
    none, few = wilson(0, 54), wilson(9, 10)
    assert none["low"] == pytest.approx(0) and none["high"] == pytest.approx(
        0.0664, abs=1e-3
    )  # published tables of the interval
    assert few["low"] == pytest.approx(0.596, abs=2e-3) and few["high"] == pytest.approx(0.982, abs=2e-3)


def test_the_page_says_what_was_not_run(tmp_path: Path):
    page = "<!-- rates:begin -->\n<!-- rates:end -->\n<!-- runs:begin -->\n<!-- runs:end -->"
    (tmp_path / "results-physics.md").write_text(page)
    write_results([], tmp_path, command="python -m benchmarks.physics_points")
    assert (
        "| nothing hidden: false alarm | not run | not run | <= 2 % |" in (tmp_path / "results-physics.md").read_text()
    )
    assert (
        json.loads((tmp_path / "results" / "physics_points.json").read_text())["sets"]["null"]["false_alarm"]["n"] == 0
    )


def test_runs_that_shaped_the_rules_are_told_apart():
    names = [plan.name for plan in PLAN]
    assert len(set(names)) == len(names) and set(names) >= DEVELOPED
    first = DEVELOPED - REASONS
    assert set(names[-len(first) :]) == first, "what was looked at while rules were made comes last"
    assert not any(name.startswith("outside-fresh") for name in DEVELOPED)


def test_the_tables_of_another_engine_are_a_result_of_their_own(tmp_path: Path):
    write_results([run("a")], tmp_path, command="python -m benchmarks.physics_points")
    before = (tmp_path / "results" / "physics_points.json").read_bytes()
    write_results([run("b")], tmp_path, command="python -m benchmarks.physics_points --result R", result="physics-570")
    assert (tmp_path / "results" / "physics_points.json").read_bytes() == before
    assert json.loads((tmp_path / "results" / "physics-570.json").read_text())["runs"][0]["name"] == "b"


def test_a_row_that_the_file_kept_counts_as_it_did_when_it_was_run(tmp_path: Path):
    write_results(rows(), tmp_path, command="python -m benchmarks.physics_points")
    path = tmp_path / "results" / "physics_points.json"
    fresh = json.loads(path.read_text())
    kept = newest_rows([row["name"] for row in rows()], tmp_path / "work", written_rows(path))
    assert all("parameters" not in row for row in kept)
    write_results(kept, tmp_path, command="python -m benchmarks.physics_points")
    assert json.loads(path.read_text()) == fresh and fresh["sets"]["parameter_error"]["covered"]["n"] == 1


def test_a_folder_s_row_goes_before_the_written_one_and_another_version_s_is_made_anew(tmp_path: Path):
    written = {
        name: run(name, judged_by=version)
        for name, version in (("null-0", STAGE.version), ("null-1", STAGE.version - 1), ("null-2", STAGE.version - 1))
    }
    (tmp_path / "null-1.json").write_text(json.dumps(run("null-1", seed=7)))
    assert [is_judged(name, tmp_path, written) for name in ("null-0", "null-1", "null-2", "null-3")] == [
        True,
        True,
        False,
        False,
    ]
    newest = newest_rows(["null-3", "null-2", "null-1", "null-0"], tmp_path, written)
    assert [row["seed"] for row in newest] == [1, 7, 1]


def test_processes_share_the_plan_without_overlap():
    assert sorted(shared(PLAN, "1/2") + shared(PLAN, "2/2"), key=PLAN.index) == PLAN


def test_what_an_earlier_version_hid_is_hidden_again(tmp_path: Path, monkeypatch):
    made = []

    def noted(plan, setting, work, jobs, earlier):
        made.append((plan.name, earlier and earlier["hidden"]))
        return run(plan.name)

    monkeypatch.setattr(physics_points, "run_plan", noted)
    plans = [plan for plan in PLAN if plan.name in ("snr4-tilt", "snr4-viscosity", "snr4-swelling")]
    written = {"snr4-tilt": run("snr4-tilt", hidden=TILT), "snr4-viscosity": run("snr4-viscosity", set="unreachable")}
    physics_points.run_missing(plans, None, tmp_path, 1, time.monotonic() + 60, written)
    assert sorted(made) == [("snr4-swelling", None), ("snr4-tilt", TILT)]
    swelling = next(plan for plan in plans if plan.name == "snr4-swelling")
    effects, reached = physics_points._hidden(
        swelling, physics_points.SCENE, 1, run("x", hidden={"swelling": {"rate_per_s": 0.03}})
    )
    assert ([(e.name, e.values) for e in effects], reached) == ([("swelling", {"rate_per_s": 0.03})], None)


def test_other_methods_are_given_what_the_run_hid(tmp_path, monkeypatch):
    plan = next(plan for plan in PLAN if plan.name == "snr4-swelling")
    row = run(plan.name, set="single", hidden={"swelling": {"rate_per_s": 0.03}})
    (tmp_path / f"{plan.name}.json").write_text(json.dumps(row))
    given: list[dict[str, float]] = []

    def noted(scene, seed, count, effects, jobs):
        given.extend(effect.values for effect in effects)
        return []

    monkeypatch.setattr(physics_points, "simulated", noted)
    monkeypatch.setattr(physics_points, "sindy_ranking", lambda episodes, predictions: [["swelling"]])
    physics_points._add_sindy(plan, None, tmp_path, 1)
    assert given == [{"rate_per_s": 0.03}]  # scaled to the run's signal, not as the plan starts from
    assert json.loads((tmp_path / f"{plan.name}.json").read_text())["baselines"]["sindy"] == [["swelling"]]
