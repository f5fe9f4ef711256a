"""The hidden DiSECt sets through cameras: what is typed, and what the result keeps of a diagnosis."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks.datasets.hidden_disect import (
    BASES,
    PRISM,
    RANKED,
    REPEATED,
    SETS,
    SETTINGS,
    Sets,
    answer_of,
    collected,
    merged,
)
from stages.filter.stage import FilterConfig
from stages.identify.stage import IdentifyConfig

ROW = {
    "effect": "tilt",
    "gain": 0.123456,
    "gain_error": 0.01,
    "p": 0.005,
    "strength": 12.5,
    "passes": True,
    "reasons": [],
    "help": "dropped",
    "parameters": {"gx": {"value": 1.23456, "low": None, "high": 2.0, "unit": "m/s^2", "at_bound": 1}},
}


FACTS = {
    "verdict": {"kind": "EFFECT", "named": ["tilt"], "text": "Missing: tilt."},
    "error": 2.000049,
    "floor": None,
    "searches": 400,
    "episodes": ["a"],
    "reference_episodes": [],
    "limits": "dropped",
    "ranking": [ROW, *({**ROW, "effect": f"law_{k}"} for k in range(RANKED + 1))],
}


def store_of(folder: Path, facts: dict) -> SimpleNamespace:
    """A store in which every name is a diagnosis, and a comparison, too."""
    (folder / "diagnosis.json").write_text(json.dumps(facts))
    manifest = SimpleNamespace(stage_version=14, summary={"figures": {"rms_mm": 1.25}}, provenance={"seconds": 1.0})
    asked: list[str] = []
    found = SimpleNamespace(path=folder, manifest=manifest)
    return SimpleNamespace(asked=asked, find=lambda name: asked.append(name) or found)


@pytest.fixture
def typed(monkeypatch) -> list[tuple[str, ...]]:
    words: list[tuple[str, ...]] = []
    monkeypatch.setattr(Sets, "plop", lambda self, *given: words.append(given))
    return words


def loop(tmp_path: Path, facts: dict) -> Sets:
    made = Sets(tmp_path / "w", tmp_path / "data")
    made.store = store_of(tmp_path, facts)
    return made


def test_settings_are_those_that_the_stages_know():
    for stage, config in (("filter", FilterConfig), ("identify", IdentifyConfig)):
        assert set(tomllib.loads(SETTINGS)[stage]) <= set(config.__dataclass_fields__)


def test_the_base_is_made_of_the_recordings_without_a_change(tmp_path, typed):
    loop(tmp_path, FACTS).base(PRISM)
    assert [words[0] for words in typed] == ["ingest", "calibrate", "identify"]
    assert not any("disect_hidden" in word for words in typed for word in words)


def test_a_set_is_diagnosed_against_a_reference_that_is_not_itself(tmp_path, typed):
    found = [
        loop(tmp_path, FACTS).diagnosed(name, folder, to) for name, (folder, others) in SETS.items() for to in others
    ]
    asked = [words for words in typed if words[0] == "diagnose"]
    assert len(asked) == len(found) == 9
    for words in asked:
        reference, recordings = (words[words.index(f"--{option}") + 1] for option in ("reference", "recordings"))
        assert reference != recordings and reference in (*BASES, REPEATED)
    assert [each["reference"] for each in found[1:3]] == ["other motions", "repeated motions"]


def test_a_set_that_is_diagnosed_anew_replaces_its_old_row():
    old = [{"set": "a", "left_out": left, "reference": r, "v": 1} for r, left in (("r", ""), ("s", ""), ("r", "law"))]
    new = {**old[0], "v": 2}
    assert merged(old, [new]) == [*old[1:], new]


def test_answers_are_words():
    answers = {"set_1": {"effect": "shrinkage", "amplitude": "5 %"}, "set_2": {"effect": None, "amplitude": None}}
    assert [answer_of(answers, name) for name in ("set1", "set2", REPEATED)] == ["shrinkage, 5 %", "nothing", "nothing"]


def test_a_diagnosis_is_kept_with_its_version_and_the_best_effects(tmp_path):
    store = store_of(tmp_path, FACTS)
    kept = collected(store, "unseen1")
    assert store.asked == ["unseen1"] and kept["diagnose_version"] == 14
    assert (kept["verdict"], kept["named"], kept["error"], kept["floor"]) == ("EFFECT", ["tilt"], 2.0, None)
    assert [row["effect"] for row in kept["ranking"]] == ["tilt", "law_0", "law_1", "law_2"]
    assert kept["ranking"][0]["parameters"] == {"gx": {"value": 1.2346, "low": None, "high": 2.0, "unit": "m/s^2"}}
    assert "dropped" not in json.dumps(kept)
