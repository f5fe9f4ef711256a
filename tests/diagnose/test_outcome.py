"""What a diagnosis writes of its rows: whether parameters are determined, and no share below nothing in its table."""

from __future__ import annotations

import re

import numpy as np

from plop.diagnosis.finding import Finding
from plop.physics.effects.library import library
from plop.statistics.determined import NOT_DETERMINED
from stages.diagnose.outcome import _row, rows_of


def finding(name: str, low: float, high: float, gain: float = 0.5, **more: dict) -> Finding:
    [first, *_] = library(())[name].amplitudes
    value = {"value": (low + high) / 2, "low": low, "high": high, "unit": first.unit, "at_bound": False}
    return Finding(name, "physics", {first.name: value, **more}, gain, 0.1, 0.005, None)


def test_rows_say_what_the_recordings_determine_by_the_range_of_each_law():
    tried = {
        "value": 0.1,
        "low": -np.inf,
        "high": np.inf,
        "unit": "s",
        "at_bound": False,
        "chosen": True,
        "also": [0.03, 0.3],
    }
    open_ended = _row(finding("adhesion", 184.0, 7890.0, release_s=tried), library(()), None)["parameters"]
    assert not open_ended["traction_pa"]["determined"] and not open_ended["release_s"]["determined"]
    assert open_ended["release_s"]["low"] is None
    known = _row(finding("adhesion", 184.0, 700.0, release_s={**tried, "also": []}), library(()), None)["parameters"]
    assert known["traction_pa"]["determined"] and known["release_s"]["determined"]
    assert "determined" in _row(finding("tilt", 0.1, 0.2), {}, None)["parameters"]["gx_m_s2"], "a law of the user's"


def test_the_table_says_that_a_law_does_not_help_instead_of_minus_200_per_cent():
    laws = [finding("adhesion", 184.0, 7890.0), finding("tilt", 0.1, 0.2, gain=-2.0)]
    rows = [_row(law, library(()), 1e-3) for law in laws]
    base = _row(finding("stiffness", -0.1, 0.2, gain=-1.5), library(()), None)
    shown = rows_of({"ranking": rows, "base": base, "verdict": {"named": ["adhesion"]}})
    assert [row["explains"] for row in shown] == ["50.0 ± 10.0 %", "does not help", "does not help"]
    assert NOT_DETERMINED in shown[0]["parameter"] and NOT_DETERMINED not in shown[1]["parameter"]
    assert not any(re.search(r"-\d", reason) for row in rows[1:] for reason in row["reasons"]), rows[1]["reasons"]
