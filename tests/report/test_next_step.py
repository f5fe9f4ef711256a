"""What to do next, and what parameters may be, stand in the report."""

from plop.reporting.diagnosis_section import _next
from plop.reporting.parameters_section import parameters_text


def test_commands_are_set_as_code_and_nothing_is_taken_for_html():
    shown = _next({"next_step": "Add it: `plop augment --effect a<b`; then look."})
    assert "<code>plop augment --effect a&lt;b</code>; then look." in shown
    assert _next({"next_step": ""}) == _next({}) == ""


def test_a_setting_stands_beside_those_that_do_as_well():
    setting = {"value": 0.3, "low": None, "high": None, "unit": "s", "at_bound": False, "also": [0.03, 0.1]}
    assert "release_s = 0.3 (or 0.03, 0.1) s" in parameters_text({"release_s": setting}, "adhesion")
    assert parameters_text({"release_s": {**setting, "also": []}}, "adhesion") == "release_s = 0.3 (no interval) s"
