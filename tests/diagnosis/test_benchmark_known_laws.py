"""The benchmark of known laws: its sums by hand, and that a law at its true amplitude explains what it did."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import known_laws
from plop.physics.effects.library import effect_type


def test_errors_and_the_best_factor_by_hand():
    response = np.array([[3.0, 0, 0], [0, 4.0, 0]]) / 1000
    found = known_laws.summary(0.5 * response, response)
    assert found["without_mm"] == pytest.approx(0.5 * np.sqrt(12.5))
    assert found["with_mm"] == pytest.approx(0.5 * np.sqrt(12.5)) and found["factor"] == pytest.approx(0.5)


def test_a_law_explains_what_it_did(tmp_path, monkeypatch):
    monkeypatch.setattr(known_laws, "SPACING_M", 0.008)
    found = known_laws.left(effect_type("swelling")(rate_per_s=-0.3), episodes=1)
    assert found["with_mm"] < 0.7 * found["without_mm"] and found["factor"] == pytest.approx(1, abs=0.3)
    assert known_laws.table([{"law": "swelling", "values": {"rate_per_s": -0.3}, **found}]).count("\n") == 2


def test_the_command_writes_the_file_and_the_page(tmp_path, monkeypatch):
    monkeypatch.setattr(known_laws, "left", lambda *_, **__: {"without_mm": 1.0, "with_mm": 0.4, "factor": 1.1})
    monkeypatch.setattr("sys.argv", ["known_laws", "--laws", "tilt", "--out", str(tmp_path)])
    (tmp_path / "results").mkdir()
    (tmp_path / "results-physics.md").write_text("<!-- known-laws:begin -->\n<!-- known-laws:end -->\n")
    known_laws.main()
    assert [law["law"] for law in json.loads((tmp_path / "results" / "known_laws.json").read_text())["laws"]] == [
        "tilt"
    ]
    assert "| tilt (gx_m_s2 -0.8, gy_m_s2 -3.2) | 1.00 | 0.40 | 1.10 |" in (tmp_path / "results-physics.md").read_text()
