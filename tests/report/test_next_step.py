"""What to do next, and what parameters may be, stand in the report."""

from plop.parameters import Estimate
from plop.reporting.compared import Compared, ModelNumbers, ReportFacts
from plop.reporting.diagnosis_section import diagnosis_section
from plop.reporting.page_file import render
from plop.reporting.parameters_section import parameters_section
from tests.support.diagnoses import diagnosis, ranked, verdict


def section(*rows, **changes) -> str:
    found = diagnosis(verdict("EFFECT"), *rows, **changes)
    return render("diagnosis.html", diagnosis=diagnosis_section("base", found))


def test_commands_are_set_as_code_and_nothing_is_taken_for_html():
    shown = section(next_step="Add it: `plop augment --effect a<b`; then look.")
    assert "<code>plop augment --effect a&lt;b</code>; then look." in shown
    assert "What to do next" not in section(next_step="")


def test_a_setting_stands_beside_those_that_do_as_well():
    others = Estimate(0.3, unit="s", alternatives=(0.03, 0.1), fitted=False)
    alone = Estimate(0.3, unit="s", fitted=False)
    shown = section(ranked("adhesion", {"release_s": others, "other_s": alone}))
    assert "release_s = 0.3 (or 0.03, 0.1) s" in shown and "other_s = 0.3 (no interval) s" in shown


def test_what_was_given_has_the_unit_that_is_declared():
    given = {"table_slip_m_s": 0.02, "density_kg_m3": 1000.0, "poisson": 0.4}
    compared = Compared("base", "#000000", None, ModelNumbers(given=given))  # type: ignore[arg-type]
    made = parameters_section(ReportFacts("t", [compared]))
    assert [row.estimate.unit for row in made.given] == ["m/s", "kg/m^3", "-"]
    assert "Given, not fitted" in render("parameters.html", parameters=made)
