"""The same runs judged by two versions, side by side."""

from __future__ import annotations

from typing import Any

from benchmarks.missing_physics.compare import compared
from benchmarks.missing_physics.row import Row


def row(name: str, traction_pa: float, **more: Any) -> Row:
    fitted = {
        "traction_pa": {"value": traction_pa, "low": 0.5 * traction_pa, "high": 2 * traction_pa},
        "release_s": {"value": 0.1, "low": None, "high": None, "chosen": True},
    }
    kept = {
        "name": name,
        "set": "single",
        "seed": 3009,
        "snr": 2.0,
        "hidden": {"adhesion": {"traction_pa": 1725.4}},
        "verdict": "EFFECT",
        "named": ["adhesion"],
        "error": 10.0,
        "floor": 2.0,
        "left": 4.0,
        "parameters": {"adhesion": fitted},
        **more,
    }
    return Row.from_json(kept)


def test_runs_of_both_results_stand_beside_each_other():
    nothing = {"hidden": {}, "named": [], "verdict": "NOTHING DETECTABLE", "set": "null", "parameters": {}}
    before = [row("a", 300.0), row("null", 0.0, **nothing), row("only before", 1.0)]
    after = [row("a", 400.0), row("null", 0.0, **nothing), row("new", 1.0), row("far", 1.0, set="unreachable")]
    assert compared(before, after).splitlines()[2:] == [
        "| single 3009 | adhesion, traction_pa 1730 | EFFECT adhesion (75 %) | 300 (150 to 600), release_s 0.1 "
        "| EFFECT adhesion (75 %) | 400 (200 to 800), release_s 0.1 |",
        "| null 3009 | - | NOTHING DETECTABLE | - | NOTHING DETECTABLE | - |",
    ]


def test_a_file_without_amplitudes_says_how_far_they_are_off():
    older = {"amplitude_off": 0.123, "response": {"cosine": 0.987}}
    kept = {
        "name": "a",
        "set": "single",
        "seed": 1,
        "snr": 2.0,
        "hidden": {"tilt": {"gx_m_s2": 1.0}},
        "verdict": "EFFECT",
        "named": ["tilt"],
        "error": 10.0,
        "floor": 2.0,
        "left": 4.0,
    }
    found = compared([Row.from_json({**kept, **older})], [Row.from_json(kept)])
    assert found.endswith("| EFFECT tilt (75 %) | 12 % off, cosine 0.99 | EFFECT tilt (75 %) | - |")
