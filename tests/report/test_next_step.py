"""What to do next, and what parameters may be, stand in the report."""

from plop.parameters import Estimate
from plop.reporting.compared import Compared, ModelNumbers
from plop.reporting.diagnosis_section import _next
from plop.reporting.parameters_section import _given, parameters_text
from tests.support.diagnoses import diagnosis, verdict


def test_commands_are_set_as_code_and_nothing_is_taken_for_html():
    shown = _next(diagnosis(verdict("EFFECT"), next_step="Add it: `plop augment --effect a<b`; then look."))
    assert "<code>plop augment --effect a&lt;b</code>; then look." in shown
    assert _next(diagnosis(verdict("EFFECT"), next_step="")) == ""


def test_a_setting_stands_beside_those_that_do_as_well():
    others = Estimate(0.3, unit="s", alternatives=(0.03, 0.1), fitted=False)
    assert "release_s = 0.3 (or 0.03, 0.1) s" in parameters_text({"release_s": others})
    alone = Estimate(0.3, unit="s", fitted=False)
    assert parameters_text({"release_s": alone}) == "release_s = 0.3 (no interval) s"


def test_what_was_given_has_the_unit_that_is_declared():
    given = {"table_slip_m_s": 0.02, "density_kg_m3": 1000.0, "poisson": 0.4}
    rows = _given(Compared("base", "#000000", None, ModelNumbers(given=given)))  # type: ignore[arg-type]
    assert [row[-1] for row, _ in rows] == ["m/s", "kg/m^3", "-"]
