"""The benchmark through cameras types what a user types, and opens the answer only after the verdict."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import physics_cameras
from benchmarks.physics_cameras import Loop, Run, planned, write
from benchmarks.physics_rough import RECORDED, rough_runs
from plop.errors import SignalTooWeakError
from plop.physics.effects.library import library
from plop.physics.hidden.wish import parse_hidden
from plop.physics.scenes.sealed import seal_answer
from stages.diagnose.stage import STAGE

LAW = {
    "kind": "physics",
    "gain": 0.9,
    "gain_error": 0.1,
    "p": 0.005,
    "contrast": 8.0,
    "contrast_p": 0.001,
    "reasons": [],
    "parameters": {"gx_m_s2": {"value": 1.1, "low": 0.9, "high": 1.3}},
}
DIAGNOSIS = {
    "verdict": {"kind": "EFFECT", "named": ["tilt"], "text": "Missing: tilt.", "evidence": {"left": 2.0}},
    "ranking": [{"effect": "tilt", **LAW}, {"effect": "drag", **LAW}],
    "base": {"effect": "stiffness", **LAW},
    "error": 9.0,
    "floor": 1.0,
    "dropped": {},
    "engine_runs": 7,
}


@pytest.fixture
def loop(tmp_path: Path, monkeypatch) -> SimpleNamespace:
    """A workspace in which commands are noted instead of run; `strongest` is the largest signal that can be had."""
    typed: list[list[str]] = []
    state = SimpleNamespace(typed=typed, strongest=9.0, opened=[])

    def plop(self: Loop, *words: str) -> None:
        typed.append(list(words))
        if words[0] == "simulate" and "--snr" in words and float(words[words.index("--snr") + 1]) > state.strongest:
            raise SignalTooWeakError("The effect cannot give the wanted signal in these motions.")

    def find(name: str) -> SimpleNamespace:
        folder = tmp_path / name
        folder.mkdir(exist_ok=True)
        seal_answer(folder, {"effects": {"tilt": {"gx_m_s2": 1.0}}, "rms_m": 1e-3, "snr": 2.0})
        (folder / "diagnosis.json").write_text(json.dumps(DIAGNOSIS))
        (folder / "model.json").write_text(json.dumps({"estimates": {"tool_friction": {"value": 0.24}}}))
        return SimpleNamespace(path=folder, manifest=SimpleNamespace(stage_version=27))

    def open_answer(path: Path) -> dict:
        state.opened.append(len(typed))
        return opened(path)

    opened = physics_cameras.open_answer
    monkeypatch.setattr(physics_cameras, "open_answer", open_answer)
    monkeypatch.setattr(Loop, "plop", plop)
    state.loop = Loop(tmp_path / "workspace")
    state.loop.store = SimpleNamespace(find=find)
    return state


def test_the_plan_can_be_typed_and_a_stop_leaves_all_sets_represented():
    plan = planned()
    assert len({run.name for run in plan}) == len(plan) == len({run.seed for run in plan})
    for run in plan:
        assert len(parse_hidden(run.hide)) == (2 if run.set == "pair" else bool(run.hide))
    assert {run.set for run in plan[:12]} == {"single", "null", "pair", "outside", "sensor", "base", "decoy"}


def test_the_answer_is_opened_after_the_verdict(loop):
    row = loop.loop.carry_out(Run("snr4-tilt", "single", 3, ("tilt.gx_m_s2=1",), 4.0))
    assert [words[0] for words in loop.typed] == ["simulate", "diagnose"] and loop.opened == [2]
    assert (row["ranks"], row["snr"], row["left"], row["judged_by"]) == ([1], 2.0, 2.0, 27)
    assert set(row["parameters"]) == {"tilt", "drag", "stiffness"} and row["base"] == {"tool_friction": 0.24}


def test_half_the_signal_is_taken_where_the_whole_cannot_be_had(loop):
    loop.strongest = 3.0
    assert loop.loop.carry_out(Run("snr4-tilt", "single", 3, ("tilt.gx_m_s2=1",), 4.0))["set"] == "single"
    assert [words[words.index("--snr") + 1] for words in loop.typed if words[0] == "simulate"] == ["4", "2"]
    loop.strongest = 1.0
    row = loop.loop.carry_out(Run("snr4-tilt", "single", 3, ("tilt.gx_m_s2=1",), 4.0))
    assert (row["set"], row["hidden"]) == ("unreachable", {"tilt": {}})


def test_a_law_outside_the_library_is_left_out_of_the_diagnosis(loop):
    loop.loop.carry_out(Run("outside-tilt", "outside", 3, ("tilt.gx_m_s2=1",), 4.0, "tilt"))
    given = [b for a, b in zip(loop.typed[-1], loop.typed[-1][1:], strict=False) if a == "--effects"]
    assert sorted(given) == sorted(set(library()) - {"tilt"})


def test_of_two_laws_the_second_is_looked_for_beside_the_first(loop):
    row = loop.loop.carry_out(Run("pair-a-b", "pair", 3, ("tilt.gx_m_s2=1", "swelling"), 4.0))
    assert [words[0] for words in loop.typed] == ["simulate", "diagnose", "augment", "diagnose"]
    assert row["tests"]["tilt"]["contrast_p"] == 0.001
    assert loop.typed[-1][2] == loop.typed[-2][-1] and row["next_named"] == ["tilt"]


def test_bad_cameras_film_the_base_and_every_run(loop):
    loop.loop.recorded = RECORDED
    loop.loop.base()
    runs = rough_runs()
    assert [run.set for run in runs].count("null") == 2 and len({run.seed for run in runs}) == len(runs)
    assert not {run.seed for run in runs} & {run.seed for run in planned()}
    loop.loop.carry_out(runs[0])
    filmed = [words for words in loop.typed if words[0] == "simulate"]
    assert len(filmed) == 2 and all(words[6 : 6 + len(RECORDED)] == list(RECORDED) for words in filmed)


def test_tables_are_written_beside_their_goals(loop, tmp_path):
    rows = [
        loop.loop.carry_out(Run("snr4-tilt", "single", 3, ("tilt.gx_m_s2=1",), 4.0)),
        loop.loop.carry_out(Run("sensor-clock", "sensor", 4, fault="clock=0.02")),
    ]
    page = tmp_path / "results-physics.md"
    page.write_text(
        "".join(f"<!-- cameras-{name}:begin -->\n<!-- cameras-{name}:end -->\n" for name in ("rates", "runs"))
    )
    write(rows, tmp_path)
    assert "| one effect, SNR >= 2: named first | 100 % (21 to 100 %, n = 1) | >= 90 % |" in page.read_text()
    assert "| a sensor fault only: called physics | 100 % (21 to 100 %, n = 1) | <= 5 % |" in page.read_text()
    assert "| median error of the parameter | 10 % (n = 1) | <= 10 % |" in page.read_text()
    facts = json.loads((tmp_path / "results" / "physics_cameras.json").read_text())
    assert facts["planned"] == len(planned()) and len(facts["runs"]) == 2
    assert "| EFFECT | tilt | 1 | 27 |" in page.read_text()


def test_a_run_that_the_workspace_does_not_hold_keeps_its_newest_verdict(loop, tmp_path, monkeypatch):
    (tmp_path / "results-physics.md").write_text(
        "".join(f"<!-- cameras-{name}:begin -->\n<!-- cameras-{name}:end -->\n" for name in ("rates", "runs"))
    )
    first, second = planned()[:2]
    rows = [{**loop.loop.carry_out(first), "judged_by": 23}, {**loop.loop.carry_out(second), "judged_by": 24}]
    write(rows, tmp_path)
    folder = tmp_path / "work" / "rows"
    folder.mkdir(parents=True)
    (folder / f"{second.name}.json").write_text(json.dumps(loop.loop.carry_out(second)))
    monkeypatch.setattr("sys.argv", ["-", "--summary", "--work", str(tmp_path / "work"), "--out", str(tmp_path)])
    physics_cameras.main()
    facts = json.loads((tmp_path / "results" / "physics_cameras.json").read_text())
    assert {row["name"]: row["judged_by"] for row in facts["runs"]} == {first.name: 23, second.name: 27}


def test_only_runs_that_this_version_has_not_judged_are_made(loop, tmp_path, monkeypatch):
    (tmp_path / "results-physics.md").write_text(
        "".join(f"<!-- cameras-{name}:begin -->\n<!-- cameras-{name}:end -->\n" for name in ("rates", "runs"))
    )
    plan = planned()[:3]
    versions = (STAGE.version, STAGE.version - 1)
    write([{**loop.loop.carry_out(run), "judged_by": v} for run, v in zip(plan, versions, strict=False)], tmp_path)
    loop.typed.clear()
    monkeypatch.setattr(physics_cameras, "Loop", lambda _: loop.loop)
    monkeypatch.setattr(physics_cameras, "planned", lambda: plan)
    monkeypatch.setattr("sys.argv", ["-", "--work", str(tmp_path / "work"), "--out", str(tmp_path)])
    physics_cameras.main()
    assert simulated(loop.typed) == ["plain", plan[1].name, plan[2].name]
    loop.typed.clear()
    monkeypatch.setattr("sys.argv", ["-", "--again", "--work", str(tmp_path / "work"), "--out", str(tmp_path)])
    physics_cameras.main()
    assert simulated(loop.typed) == ["plain", plan[0].name], "what the workspace lacks"


def simulated(typed: list[list[str]]) -> list[str]:
    return [words[words.index("--name") + 1] for words in typed if words[0] == "simulate"]
