"""What to do next stands in the report, commands set as commands."""

from plop.reporting.diagnosis_section import _next


def test_commands_are_set_as_code_and_nothing_is_taken_for_html():
    shown = _next({"next_step": "Add it: `plop augment --effect a<b`; then look."})
    assert "<code>plop augment --effect a&lt;b</code>; then look." in shown
    assert _next({"next_step": ""}) == _next({}) == ""
