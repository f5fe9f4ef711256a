"""The benchmark through cameras types what a user types, and opens the answer only after the verdict."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks.missing_physics import cameras
from benchmarks.missing_physics.cameras import ROUGH, Cameras
from benchmarks.missing_physics.plan import Run, cameras_plan, rough_plan
from benchmarks.missing_physics.row import Group
from plop.errors import SignalTooWeakError
from plop.physics.effects.library import library
from plop.physics.hidden.wish import parse_hidden
from plop.physics.scenes.sealed import seal_answer

LAW = {
    "kind": "physics",
    "gain": 0.9,
    "gain_error": 0.1,
    "p": 0.005,
    "strength": 18.0,
    "reasons": [],
    "parameters": {"gx_m_s2": {"value": 1.1, "low": 0.9, "high": 1.3}},
}
DIAGNOSIS = {
    "verdict": {"kind": "EFFECT", "named": ["tilt"], "text": "Missing: tilt.", "evidence": {"left": 2.0}},
    "ranking": [{"effect": "tilt", **LAW}, {"effect": "drag", **LAW}],
    "error": 9.0,
    "floor": 1.0,
    "dropped": {},
    "engine_runs": 7,
}
TILT = (("tilt", (("gx_m_s2", 1.0),)),)
BOTH = (*TILT, ("swelling", (("rate_per_s", 0.1),)))


@pytest.fixture
def loop(tmp_path: Path, monkeypatch) -> SimpleNamespace:
    """A workspace in which commands are noted instead of run; `strongest` is the largest signal that can be had."""
    typed: list[list[str]] = []
    state = SimpleNamespace(typed=typed, strongest=9.0, opened=[])

    def plop(self: Cameras, *words: str) -> None:
        typed.append(list(words))
        if words[0] == "simulate" and "--snr" in words and float(words[words.index("--snr") + 1]) > state.strongest:
            raise SignalTooWeakError("The effect cannot give the requested signal in these motions.")

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

    opened = cameras.open_answer
    monkeypatch.setattr(cameras, "open_answer", open_answer)
    monkeypatch.setattr(Cameras, "plop", plop)
    state.loop = Cameras(tmp_path / "workspace")
    state.loop.store = SimpleNamespace(find=find)
    return state


def test_the_plan_can_be_typed_and_a_stop_leaves_all_sets_represented():
    plan = cameras_plan()
    assert len({run.name for run in plan}) == len(plan) == len({run.seed for run in plan})
    for run in plan:
        assert len(parse_hidden(run.typed())) == (2 if run.group is Group.PAIR else bool(run.hidden))
    assert {run.group for run in plan[:12]} == set(Group) - {Group.UNREACHABLE}


def test_the_answer_is_opened_after_the_verdict(loop):
    row = loop.loop.carry_out(Run("snr4-tilt", Group.SINGLE, 3, TILT, 4.0), None)
    assert [words[0] for words in loop.typed] == ["simulate", "diagnose"] and loop.opened == [2]
    assert (row.ranks, row.snr, row.left, row.rms_mm) == ([1], 2.0, 2.0, 1.0)
    assert set(row.parameters) == {"tilt", "drag"} and row.base == {"tool_friction": 0.24}


def test_half_the_signal_is_taken_where_the_whole_cannot_be_had(loop):
    loop.strongest = 3.0
    assert loop.loop.carry_out(Run("snr4-tilt", Group.SINGLE, 3, TILT, 4.0), None).set is Group.SINGLE
    assert [words[words.index("--snr") + 1] for words in loop.typed if words[0] == "simulate"] == ["4", "2"]
    loop.strongest = 1.0
    row = loop.loop.carry_out(Run("snr4-tilt", Group.SINGLE, 3, TILT, 4.0), None)
    assert (row.set, row.hidden) == (Group.UNREACHABLE, {"tilt": {}})


def test_a_law_outside_the_library_is_left_out_of_the_diagnosis(loop):
    loop.loop.carry_out(Run("outside-tilt", Group.OUTSIDE, 3, TILT, 4.0, "tilt"), None)
    given = [b for a, b in zip(loop.typed[-1], loop.typed[-1][1:], strict=False) if a == "--effects"]
    assert sorted(given) == sorted(set(library()) - {"tilt"})


def test_of_two_laws_the_second_is_looked_for_beside_the_first(loop):
    row = loop.loop.carry_out(Run("pair-a-b", Group.PAIR, 3, BOTH, 4.0), None)
    assert [words[0] for words in loop.typed] == ["simulate", "diagnose", "augment", "diagnose"]
    assert row.tests["tilt"]["strength"] == 18.0
    assert loop.typed[-1][2] == loop.typed[-2][-1] and row.next_named == ["tilt"]


def test_bad_cameras_film_the_base_and_every_run(loop):
    loop.loop.recorded = ROUGH
    loop.loop.prepare()
    runs = rough_plan()
    assert [run.group for run in runs].count(Group.NULL) == 2 and len({run.seed for run in runs}) == len(runs)
    assert not {run.seed for run in runs} & {run.seed for run in cameras_plan()}
    loop.loop.carry_out(runs[0], None)
    filmed = [words for words in loop.typed if words[0] == "simulate"]
    assert len(filmed) == 2 and all(words[6 : 6 + len(ROUGH)] == list(ROUGH) for words in filmed)
