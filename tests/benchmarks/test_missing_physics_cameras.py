"""Missing physics through cameras: what is typed, and what a row keeps."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.missing_physics import cameras, cuts, filmed
from benchmarks.missing_physics.__main__ import main
from benchmarks.missing_physics.cameras import Cameras
from benchmarks.missing_physics.cuts import Cuts
from benchmarks.missing_physics.makers import Foreign
from benchmarks.missing_physics.plan import CAMERAS, FAULTS, TOOL_FAULTS, Set, plan
from benchmarks.missing_physics.points import Points
from benchmarks.missing_physics.rates import rates_of
from benchmarks.workspace import Typed
from benchmarks.worlds.knife_cuts import drawn
from plop.artifacts.names import check_name
from plop.errors import SignalTooWeakError
from plop.physics.effects.library import effect_type
from plop.recordings.readers.mesh.sequence import MeshSequence
from tests.support.box_sequence import box_sequence

FOUND = {
    "verdict": {"kind": "EFFECT", "named": ["tilt"], "text": "", "evidence": {"closed": 0.8}},
    "searches": 144,
    "error": 2.0,
    "floor": 1.0,
    "ranking": [{"effect": "tilt", "parameters": {}}] * 5,
}


@pytest.fixture
def typed(monkeypatch, tmp_path) -> list[tuple[str, ...]]:
    """What is typed; a signal of 4 times the noise is too much for the law."""
    words: list[tuple[str, ...]] = []

    def plop(self: Typed, *given: str) -> None:
        words.append(given)
        if given[-2:] == ("--snr", "4"):
            raise SignalTooWeakError("It moves too little.", fix="Less.")

    (tmp_path / "diagnosis.json").write_text(json.dumps(FOUND))
    monkeypatch.setattr(Typed, "plop", plop)
    monkeypatch.setattr(filmed, "open_answer", lambda path: {"effects": {"tilt": {"gx": 1.0}}, "snr": 2.1})
    monkeypatch.setattr("plop.artifacts.store.Store.find", lambda self, name: SimpleNamespace(path=tmp_path))
    return words


def test_a_law_is_hidden_as_strongly_as_it_can_be_and_then_judged(typed, tmp_path):
    row = Cameras(tmp_path / "w").row(Set(CAMERAS, 7, "single", "tilt", True))
    asked = [words for words in typed if words[0] == "simulate"][1:]
    assert [words[-1] for words in asked] == ["4", "2"]
    assert "--motions-seed" in asked[0] and "tilt" in asked[0]
    assert [words[0] for words in typed] == ["simulate", "identify", "simulate", "simulate", "diagnose"]
    assert row["group"] == "single" and len(row["said"]["reference"]["ranking"]) == 3
    assert rates_of([row], "reference")["single_named_first"]["rate"] == 1


def test_a_law_outside_the_library_is_left_out_of_it(typed, tmp_path):
    Cameras(tmp_path / "w").row(Set(CAMERAS, 7, "outside", "tilt", False))
    words = typed[-1]
    assert words[0] == "diagnose" and "--effects" in words and "tilt" not in words


def test_a_fault_is_hidden_instead_and_counts_for_sensors(typed, tmp_path):
    row = Cameras(tmp_path / "w").row(Set(CAMERAS, 7, "sensor", FAULTS[0], False))
    asked = [words for words in typed if words[0] == "simulate"][1]
    assert asked[-2:] == ("--fault", FAULTS[0]) and "--hide" not in asked and "--effects" not in typed[-1]
    assert rates_of([row], "reference")["sensor_called_physics"]["rate"] == 1


def test_what_no_amplitude_makes_visible_is_not_counted(typed, tmp_path, monkeypatch):
    monkeypatch.setattr(filmed, "SNRS", ("4",))
    row = Cameras(tmp_path / "w").row(Set(CAMERAS, 7, "pair", "tilt+swelling", False))
    assert row["group"] == "unreachable" and rates_of([row], "reference")["pairs_both"]["n"] == 0


def test_meshes_of_another_simulator_are_filmed_once_and_their_answer_is_opened_last(typed, tmp_path, monkeypatch):
    made = []

    def sequence(self: Foreign, number: int, hidden: dict[str, object]) -> MeshSequence:
        made.append((number, hidden))
        return box_sequence()

    monkeypatch.setattr(Foreign, "__init__", lambda self, simulator, seed: None)
    monkeypatch.setattr(Foreign, "sequence", sequence)
    found = ({"tilt": {"tilt_x_deg": 2.0}}, {"tilt": {"gx_m_s2": 0.34}}, [], 3.0)
    monkeypatch.setattr(Points, "hidden", lambda self, maker, one: found)
    one = Set("drake-cameras", 7, "single", "tilt", True)
    row = Cameras(tmp_path / "w").row(one)
    assert made == [(k, {}) for k in range(6)] + [(k, found[0]) for k in range(6)]
    films = ["ingest", "calibrate"]
    assert [words[0] for words in typed] == [*films, "identify", *films, "diagnose"]
    seeds = [words[words.index("--seed") + 1] for words in typed if "mesh" in words]
    assert len({*seeds}) == 1, "the pattern of the surface is the same in all sets"
    assert row["truth"] == found[1] and row["snr"] == 3.0 and row["group"] == "single"
    raw = tmp_path / "w" / "drake-cameras-7" / "raw"
    hidden, plain = ({path.stem for path in (raw / name).glob("*.npz")} for name in (one.name, "plain"))
    assert len(hidden) == 6 == len(plain) and not hidden & plain, "by its name a repeated motion has noise of its own"
    Cameras(tmp_path / "w").row(one)
    assert len(made) == 12


def test_a_fault_is_filmed_into_meshes(typed, tmp_path, monkeypatch):
    monkeypatch.setattr(Foreign, "__init__", lambda self, simulator, seed: None)
    monkeypatch.setattr(Foreign, "sequence", lambda self, number, hidden: box_sequence())
    row = Cameras(tmp_path / "w").row(Set("drake-cameras", 7, "sensor", TOOL_FAULTS[0], False))
    plain, faulty = [words for words in typed if "mesh" in words]
    assert "--fault" not in plain and faulty[-2:] == ("--fault", TOOL_FAULTS[0])
    assert row["group"] == "sensor" and not row["truth"]


def test_cuts_are_recorded_once_with_what_is_hidden_in_the_world_s_own_numbers(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setenv("PLOP_DISECT", str(tmp_path))
    monkeypatch.setattr(cuts, "record", lambda folder, world, motion: asked.append((folder, world, motion)))
    cuts._recorded.cache_clear()
    maker = Cuts(7)
    for law in Cuts.laws:
        hidden, found = maker.drawn(law, np.random.default_rng(0), 1.0)
        maker.sequence(0, {law: hidden})
        maker.sequence(0, {law: hidden})
        folder, world, motion = asked.pop()
        assert not asked and folder == tmp_path and motion == drawn(7, 0)
        assert {key for key, value in vars(world).items() if value != vars(maker.world)[key]} == hidden.keys()
        assert {*found} == {law} and {*found[law]} <= {p.name for p in effect_type(law).amplitudes}


def test_a_plan_is_the_same_every_time_and_has_all_groups():
    sets = list(plan(7500, 4, ["own", "mujoco", CAMERAS]))
    assert sets == list(plan(7500, 4, ["own", "mujoco", CAMERAS])) and len({s.name for s in sets}) == len(sets)
    for one in sets:
        check_name(one.name)  # of its artifacts
    assert {s.group for s in sets if s.world == CAMERAS} == {"null", "single", "outside", "pair", "sensor"}
    assert {s.law for s in sets if s.group == "sensor"} == {*FAULTS, *TOOL_FAULTS}
    assert not [s for s in sets if s.world == "mujoco" and s.group == "sensor"], "points have no cameras"
    cut = list(plan(7500, 4, ["disect-cameras"]))
    assert {law for s in cut if s.group == "pair" for law in s.law.split("+")} <= {*Cuts.laws}


def test_only_the_groups_asked_for_are_judged_with_so_many_episodes(monkeypatch, tmp_path, capsys):
    said = {"reference": {"verdict": {"kind": "EFFECT", "named": ["tilt"]}}}
    monkeypatch.setattr(Points, "row", lambda self, one: {"said": said, "snr": 2.5, "episodes": self.episodes})
    words = ["benchmark", "run", "--work", str(tmp_path), "--worlds", "mujoco", "--bases", "2", "--groups"]
    monkeypatch.setattr("sys.argv", [*words, "single", "--episodes", "12"])
    main()
    rows = [json.loads(path.read_text()) for path in (tmp_path / "rows").iterdir()]
    assert len(rows) == 4 == capsys.readouterr().out.count("-single-") and {row["episodes"] for row in rows} == {12}
    monkeypatch.setattr("sys.argv", [*words, "singles"])
    with pytest.raises(SystemExit):
        main()
    assert "--groups: some of null, single, outside, pair, sensor; not singles" in capsys.readouterr().err


def test_settings_are_the_demo_s(tmp_path: Path):
    assert (cameras.workspace(tmp_path / "w").workspace / "plop.toml").is_file()
