"""What a user's effect declares: each mistake is told with its line, before anything runs."""

from __future__ import annotations

import inspect
import os
import sys
from pathlib import Path

import pytest

from plop.errors import PlopError
from plop.physics.effects.declared import check_declared
from plop.physics.effects.library import library

WHOLE = """from plop.physics.effects.effect import Effect, Parameter

class Mine(Effect):
    name = "mine"
    help = law = source = "mine"
    amplitudes = (Parameter("a", "-", -1.0, 1.0, step=0.1, typical=0.5),)
    def before(self, body, dt):
        pass
"""
SHAPES = 'shapes = (Parameter("angle_deg", "deg", 0.0, 360.0, step=0.0),)\n    '


@pytest.mark.parametrize(
    ("old", "new", "line", "found"),
    [
        ('name = "mine"', "nome = 'mine'", 3, "nothing"),
        ('source = "mine"', 'source = ""', 5, "''"),
        ("typical=0.5),)", "typical=0.5))", 6, "a trailing comma is missing"),
        ("step=0.1", "step=0.0", 6, "0"),
        ("-1.0, 1.0", "0.5, 0.5, default=0.5", 6, "0.5 and 0.5"),
        ("-1.0, 1.0", "-1.0, 1.0, default=0.5", 6, "0.5"),
        ('name = "mine"', 'name = "my law"', 4, "'my law'"),
        ('"a", "-"', '"a", ""', 6, "''"),
        ('"a", "-"', '"a b", "-"', 6, "'a b'"),
        ('"a", "-"', '"2a", "-"', 6, "'2a'"),
        ("-1.0, 1.0, step=0.1, typical=0.5", "1.0, -1.0, step=0.1", 6, "1 and -1"),
        ("-1.0, 1.0", "0.05, 1.0", 6, "0.05 to 1"),
        ("-1.0, 1.0", '-1.0, float("inf")', 6, "inf"),
        ("step=0.1", 'step=float("nan")', 6, "nan"),
        ("step=0.1", "step=2.0", 6, "2"),
        ("step=0.1", 'step="0.1"', 6, "'0.1'"),
        ("typical=0.5),)", 'typical=0.5), Parameter("a", "-", -1.0, 1.0, step=0.1))', 6, "a twice"),
        ("typical=0.5),)", 'typical=float("nan")),)', 6, "nan"),
        ("def", "kind = 'law'\n    def", 7, "'law'"),
        ("def", f"{SHAPES}variants = ({{'angle_deg': 0.0}}, {{'angle_deg': 400.0}})\n    def", 8, "400.0"),
        ("def", f"{SHAPES}variants = ({{'angel_deg': 0.0}},)\n    def", 8, "'angel_deg'"),
        ("def", f"{SHAPES}variants = {{'angle_deg': 0.0}}\n    def", 8, "{'angle_deg': 0.0}"),
        ("def", "remembers = {'age': 0.0}\n    def", 7, "'age': 0.0"),
        ("def before(self, body, dt)", "def before(self, body)", 7, "(self, body)"),
        ("def before", "def befor", 7, "befor, which is never called"),
        ("def before(self, body, dt):\n        pass", "", 3, "none: it would have no effect"),
    ],
)
def test_what_an_effect_declares_is_looked_at_before_anything_runs(tmp_path, old, new, line, found):
    path = tmp_path / "mine.py"
    path.write_text(WHOLE)
    assert "mine" in library([path])
    assert old in WHOLE
    path.write_text(WHOLE.replace(old, new, 1))
    with pytest.raises(PlopError, match="error") as caught:
        library([path])
    assert str(caught.value.where).endswith(f"mine.py, line {line}") and found in str(caught.value.found)


LIBRARY = library()


@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_the_library_s_own_effects_declare_what_they_have_to(name):
    check_declared(LIBRARY[name], Path(inspect.getfile(LIBRARY[name])))


def test_a_file_that_was_saved_twice_in_a_second_is_read_as_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    path = tmp_path / "mine.py"
    for name in ("mine", "nine"):  # as long as the other
        path.write_text(WHOLE.replace('"mine"', f'"{name}"'))
        os.utime(path, (1e9, 1e9))
        assert name in library([path])


def test_a_law_may_inherit_what_it_declares(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(WHOLE + "class Other(Mine):\n    name = 'other'\n")
    assert {"mine", "other"} <= set(library([path]))
