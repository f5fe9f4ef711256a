"""What the page of results keeps of a diagnosis."""

from __future__ import annotations

import json
from types import SimpleNamespace

from benchmarks.hidden_disect_cameras import RANKED, collected

ROW = {"effect": "tilt", "gain": 0.123456, "gain_error": 0.01, "p": 0.005, "contrast_p": None, "passes": True,
       "reasons": [], "help": "dropped",
       "parameters": {"gx": {"value": 1.23456, "low": None, "high": 2.0, "unit": "m/s^2", "at_bound": 1}}}  # fmt: skip


def test_a_diagnosis_is_kept_with_its_version_and_the_best_effects(tmp_path):
    facts = {"verdict": {"kind": "EFFECT", "named": ["tilt"], "text": "Missing: tilt."}, "error": 2.000049,
             "floor": None, "closed_share": 0.5, "episodes": ["a"], "reference_episodes": [], "seconds": 1.0,
             "shams": "dropped", "ranking": [ROW] * (RANKED + 2),
             "base": {**ROW, "effect": "stiffness"}}  # fmt: skip
    (tmp_path / "diagnosis.json").write_text(json.dumps(facts))
    artifact = SimpleNamespace(path=tmp_path, manifest=SimpleNamespace(stage_version=14))
    asked = []
    store = SimpleNamespace(find=lambda name: asked.append(name) or artifact)
    kept = collected(store, "unseen1")
    assert asked == ["unseen1"] and kept["diagnose_version"] == 14
    assert (kept["verdict"], kept["named"], kept["error"], kept["floor"]) == ("EFFECT", ["tilt"], 2.0, None)
    assert [row["effect"] for row in kept["ranking"]] == ["tilt"] * RANKED + ["stiffness"]
    assert kept["ranking"][0]["parameters"] == {"gx": {"value": 1.2346, "low": None, "high": 2.0, "unit": "m/s^2"}}
    assert "dropped" not in json.dumps(kept)
