"""The figures of effects are those of the library, and the template of an effect runs."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.speed.effects import RESULT, keys
from plop.physics.effects.library import library
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.solver import simulate

PAGE = Path(__file__).resolve().parents[3] / "docs" / "how-to" / "write-an-effect.md"


def test_no_effect_costs_more_than_the_engine_and_no_row_is_left_over():
    figures = json.loads(RESULT.read_text(encoding="utf-8"))["effects"]
    assert figures and set(figures) <= set(keys())
    assert max(figure["cost"] for figure in figures.values()) < 1


def test_the_template_is_an_effect_that_obeys_its_law(tmp_path, block):
    source = re.search(r'```python title="my_effect.py"\n(.*?)```', PAGE.read_text(encoding="utf-8"), re.DOTALL)
    path = tmp_path / "my_effect.py"
    path.write_text(source[1])
    draught = library([path])["draught"]
    assert draught().absent and draught.amplitudes[0].step > 0
    body = block((0.02, 0.02, 0.02), 0.005)
    config = EngineConfig(dx_m=0.01, gravity_m_s2=(0, 0, 0), table_z_m=None)
    run = simulate(body, Material(), None, np.array([0, 0.05]), config, effects=[draught(shear_per_s2=20)])
    moved = (run.positions[-1] - run.positions[0])[:, 0].mean()
    assert moved == pytest.approx(0.5 * 20 * 0.01 * 0.05**2, rel=0.05)
