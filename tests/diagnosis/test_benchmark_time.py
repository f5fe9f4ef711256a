"""The benchmark of how long diagnose takes: its libraries and its table."""

from __future__ import annotations

from benchmarks.diagnose_time import HIDDEN, libraries, table
from plop.physics.effects.library import library


def test_twelve_laws_act_on_the_object_and_the_hidden_one_can_be_left_out():
    twelve, whole, without = libraries().values()
    assert len(twelve) == 12 and HIDDEN in twelve and not {"drag", "stiffness"} & set(twelve)
    assert whole == list(library()) and set(whole) - set(without) == {HIDDEN}


def test_the_table_has_minutes_beside_their_goals():
    row = {
        "what": "twelve laws",
        "laws": 12,
        "engine_runs": 824,
        "screen_s": 166.4,
        "whole_s": 274.8,
        "verdict": "EFFECT",
        "named": ["adhesion"],
    }
    text = table({"diagnoses": [row], "report": {"seconds": 1.85, "megabytes": 4.08}})
    assert "| diagnose, twelve laws (12) | 824 | 2.8 | 4.6 | EFFECT adhesion |" in text
    assert "| <= 6 | <= 15 |" in text and "1.9 s (goal <= 30), 4.1 MB (goal <= 25)" in text
