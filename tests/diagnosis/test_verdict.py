"""Every verdict, and what must never be named."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from plop.diagnosis.contrast import Contrast
from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.finding import Finding
from plop.diagnosis.judge import first_of, judge, judge_pair
from plop.diagnosis.unnamed import among
from plop.diagnosis.verdict import Grounds, Lone, Reason, Verdict, VerdictKind
from plop.parameters import Estimate
from stages.diagnose.outcome import _row

CLEAR, SAME = Contrast(8.0, 0.001, np.array([0.1]), np.zeros(1)), Contrast(3.5, 0.07, np.array([2.0]), np.zeros(1))


def finding(name: str = "tilt", **changes: Any) -> Finding:
    value = Estimate(1.0, 0.9, 1.1, "m/s^2")
    kind = {"drag": "decoy", "stiffness": "base", "damping": "base"}.get(name, "physics")
    found = Finding(name, kind, {"gx_m_s2": value}, gain=0.6, gain_error=0.05, p=0.005, contrast=CLEAR)
    return replace(found, **changes)


def at_bound(name: str = "tilt") -> Finding:
    return finding(name, parameters={"gx_m_s2": replace(finding().parameters["gx_m_s2"], at_bound=True)})


WEAK: dict[str, Any] = {"gain": 0.01, "p": 0.6}


def told(
    findings: list[Finding],
    confounds: list[str],
    base: Finding | None,
    sensors: list[str],
    *,
    left: float | None,
    second: tuple[Finding, float] | None = None,
    raw: float = 20.0,
    **size: Any,
) -> Verdict:
    return judge(findings, confounds, base, sensors, ErrorSize(raw=raw, **size), left=left, second=second)


FACTS: dict[str, Any] = {"error": 5.0, "floor": 1.0, "left": 1.2, "excess": 9.0}
QUIET: dict[str, Any] = {"error": 1.0, "floor": 1.0, "left": 1.0, "excess": 0.2}


def test_an_effect_that_closes_the_gap_is_named():
    verdict = told([finding(), finding("fibres", **WEAK)], [], finding("stiffness", **WEAK), [], **FACTS)
    assert (verdict.kind, verdict.named) == ("EFFECT", ("tilt",))
    assert "60 % of the held-out error" in verdict.text and "95 % of the explainable gap" in verdict.text
    assert "gx_m_s2 = 1 (0.9 to 1.1) m/s^2" in verdict.text
    assert verdict.evidence.error == 5.0


def test_an_effect_that_closes_less_than_half_is_named_in_part():
    verdict = told([finding()], [], None, [], **{**FACTS, "left": 3.5})
    assert (verdict.kind, verdict.named) == ("PARTLY", ("tilt",))


def test_look_alikes_that_leave_much_are_a_part_too():
    verdict = told([finding(), finding("fibres")], ["fibres"], None, [], **{**FACTS, "left": 3.5})
    assert (verdict.kind, verdict.named) == ("PARTLY", ("tilt", "fibres"))
    assert "Partly tilt, or fibres" in verdict.text and verdict.evidence.alternatives == ("fibres",)


def test_a_law_that_leaves_most_of_the_gap_needs_a_gap_beyond_chance():
    facts: dict[str, Any] = {"error": 3.2, "floor": 1.2, "left": 2.4, "excess": 2.0}
    verdict = told([finding(gain=0.25)], [], None, [], **facts, excess_p=0.01)
    assert (verdict.kind, verdict.named) == ("PARTLY", ("tilt",))
    assert told([finding(gain=0.25)], [], None, [], **facts, excess_p=0.1).kind == "NOTHING DETECTABLE"


def test_two_laws_are_both_named():
    more = finding("viscosity", gain=0.5)
    verdict = told([finding(), finding("viscosity")], ["viscosity"], None, [], **FACTS, second=(more, 1.1))
    assert (verdict.kind, verdict.named) == ("EFFECT", ("tilt", "viscosity"))
    assert verdict.evidence.left == 1.1 and "Add tilt, then diagnose again" in verdict.text


@pytest.mark.parametrize("changes", [{"gain": 0.08}, {"contrast": SAME}, {"p": 0.2}])
def test_a_second_law_must_pass_too(changes: dict[str, Any]):
    more = finding("viscosity", **{"gain": 0.5, **changes})
    verdict = told([finding()], [], None, [], **FACTS, second=(more, 1.1))
    assert (verdict.kind, verdict.named, verdict.evidence.left) == ("EFFECT", ("tilt",), 1.2)


def test_a_base_parameter_that_leaves_most_of_the_gap_is_a_part():
    verdict = told([finding(**WEAK)], [], finding("stiffness"), [], **FACTS, raw=7.0)
    assert (verdict.kind, verdict.named) == ("PARTLY", ("stiffness",))
    verdict = told([finding(**WEAK)], [], finding("stiffness"), [], **FACTS, raw=20.0)
    assert (verdict.kind, verdict.named) == ("BASE PARAMETER", ("stiffness",))


def test_a_parameter_that_leaves_an_error_which_stands_out_is_a_part_whichever_test_says_so():
    """A few episodes that are very wrong: dealt out anew they stand out, by standard errors they do not."""
    size: dict[str, Any] = {"error": 6.5, "floor": 1.4, "left": 5.3, "raw": 12.1, "excess": 2.0}
    for chance, kind in ((0.003, "PARTLY"), (0.01, "BASE PARAMETER")):
        verdict = told([finding(**WEAK)], [], finding("stiffness"), [], **size, excess_p=chance)
        assert (verdict.kind, verdict.named) == (kind, ("stiffness",))


def test_an_error_in_few_episodes_stands_out_by_permutation():
    facts = {**FACTS, "excess": 2.3}
    assert told([finding(**WEAK)], [], None, [], **facts).kind == "NOTHING DETECTABLE"
    assert told([finding(**WEAK)], [], None, [], **facts, excess_p=0.003).kind == "NONE OF THESE"


def test_an_error_that_just_misses_is_told_with_what_is_asked_for():
    size: dict[str, Any] = {**FACTS, "excess": 2.3, "excess_p": 0.0067}
    lone = finding(steady=0.0, helps="block_001")
    for laws in ([finding(**WEAK)], [lone]):
        verdict = told(laws, [], None, [], **size)
        assert verdict.kind == "NOTHING DETECTABLE"
        for words in (
            "5 times that of the reference",
            "p = 0.0067",
            "p <= 0.005",
            "3 standard errors instead of 2.3",
            "Record more episodes",
        ):
            assert words in verdict.text, words
    some = among(
        told([finding(**WEAK)], [], None, [], **size),
        ["tilt", "fibres"],
        ErrorSize(raw=20.0, **{k: v for k, v in size.items() if k != "left"}),
    )
    assert "were tried can be detected in these recordings: tilt, fibres. But the mean" in some.text
    refused = told([finding(gain=0.25)], [], None, [], error=3.2, floor=1.2, left=2.4, excess=2.0, excess_p=0.04)
    assert refused.kind == "NOTHING DETECTABLE" and "2.67 times" in refused.text
    for quiet in (QUIET | {"excess_p": 0.01}, size | {"excess_p": 0.3}, size | {"floor": None}):
        assert told([finding(**WEAK)], [], None, [], **quiet).text.count(".") == 1


def test_what_the_reference_shows_as_well_does_not_stand_in_the_way():
    drag = finding("drag", gain=0.7, contrast=SAME)
    verdict = told([drag, finding()], [], None, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("EFFECT", ("tilt",))
    verdict = told([finding("fibres", gain=0.7, gain_error=0.5), finding()], [], None, [], **FACTS)
    assert verdict.kind == "NONE OF THESE"  # it differs and explains more, but is not sure: nothing is named


def test_without_reference_an_effect_is_still_named():
    verdict = told([finding(contrast=None)], [], None, [], error=5.0, floor=None, left=None, excess=None)
    assert verdict.kind == "EFFECT"


def test_look_alikes_are_all_named():
    verdict = told([finding(), finding("fibres")], ["fibres"], None, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("CONFOUNDED", ("tilt", "fibres"))
    assert "tilt, or fibres" in verdict.text


def test_a_base_parameter_is_no_law():
    base = finding("stiffness")
    verdict = told([finding(**WEAK)], [], base, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("BASE PARAMETER", ("stiffness",))
    verdict = told([finding("damping")], [], finding("stiffness", **WEAK), [], **FACTS)
    assert (verdict.kind, verdict.named) == ("BASE PARAMETER", ("damping",))


def test_a_faulty_sensor_comes_before_physics():
    verdict = told([finding()], [], finding("stiffness"), ["clock of cam_01"], **FACTS)
    assert (verdict.kind, verdict.named) == ("SENSOR", ("clock of cam_01",))
    assert "--exclude" in verdict.text


def test_significant_misfit_that_nobody_explains():
    verdict = told([finding(**WEAK)], [], finding("stiffness", **WEAK), [], **FACTS)
    assert (verdict.kind, verdict.named) == ("NONE OF THESE", ())


@pytest.mark.parametrize("facts", [QUIET, {**FACTS, "excess": 2.0}, {**FACTS, "error": 1.4}])
def test_without_significant_misfit_nothing_is_detectable(facts):
    verdict = told([finding(**WEAK)], [], finding("stiffness", **WEAK), [], **facts)
    assert (verdict.kind, verdict.named) == ("NOTHING DETECTABLE", ())


def test_a_law_that_too_few_episodes_tell_is_said_and_not_named():
    doubtful = finding(gain=0.32, contrast=Contrast(3.2, 0.18, np.array([2.0]), np.zeros(1)))
    verdict = told([doubtful, finding("fibres", **WEAK)], [], finding("stiffness", **WEAK), [], **FACTS)
    assert (verdict.kind, verdict.named) == ("NONE OF THESE", ())
    assert "tilt takes 32 % of the held-out error away" in verdict.text and "p = 0.18" in verdict.text
    assert told([doubtful], [], None, [], **QUIET).text.startswith("No effect")
    assert "tilt" not in told([replace(doubtful, p=0.5)], [], None, [], **FACTS).text


@pytest.mark.parametrize("facts", [FACTS, QUIET])
def test_a_decoy_is_never_named(facts):
    verdict = told([finding("drag"), finding(**WEAK)], ["tilt"], None, [], **facts)
    assert (verdict.kind, verdict.named) == ("NONE OF THESE", ())
    verdict = told([finding(), finding("drag")], ["drag"], None, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("EFFECT", ("tilt",))


def test_a_base_parameter_that_leaves_most_of_a_gap_needs_a_gap_beyond_chance():
    facts: dict[str, Any] = {"error": 2.0, "floor": 1.2, "left": 1.9, "raw": 2.5, "excess": 1.2}
    base = finding("stiffness", gain=0.2)
    assert told([finding(**WEAK)], [], base, [], **facts, excess_p=0.3).kind == "NOTHING DETECTABLE"
    assert told([finding(**WEAK)], [], base, [], **{**facts, "excess": 3.5}, excess_p=0.001).kind == "PARTLY"
    assert told([finding(**WEAK)], [], base, [], **{**facts, "raw": 4.0}, excess_p=0.3).kind == "BASE PARAMETER"


def test_a_decoy_that_cannot_be_told_from_a_law_does_not_hide_it():
    verdict = told([finding("drag", gain=0.62), finding("damping")], ["damping"], None, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("BASE PARAMETER", ("damping",))
    verdict = told([finding("drag", gain=0.62), finding("damping")], [], None, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("NONE OF THESE", ())


def test_a_law_at_the_end_of_its_range_is_a_part_at_most():
    verdict = told([at_bound()], [], None, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("PARTLY", ("tilt",)) and "the end of its range" in verdict.text
    verdict = told([at_bound(), finding("fibres")], ["fibres"], None, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("PARTLY", ("tilt", "fibres"))
    more = finding("viscosity", gain=0.5)
    verdict = told([at_bound()], [], None, [], **FACTS, second=(more, 1.1))
    assert (verdict.kind, verdict.named) == ("PARTLY", ("tilt", "viscosity"))
    assert told([at_bound("damping")], [], None, [], **FACTS).kind == "PARTLY"


@pytest.mark.parametrize(
    "changes", [{"p": 0.5}, {"gain": 0.04}, {"gain_error": 0.4}, {"contrast": SAME}, {"steady": 0.0}]
)
def test_a_law_at_the_end_of_its_range_needs_everything_else(changes):
    assert told([replace(at_bound(), **changes)], [], None, [], **FACTS).kind == "NONE OF THESE"


def test_a_law_at_the_end_of_its_range_is_not_named_where_the_error_does_not_stand_out():
    assert told([at_bound()], [], None, [], **QUIET).kind == "NOTHING DETECTABLE"
    assert told([at_bound("drag")], [], None, [], **FACTS).named == ()
    assert told([finding(), at_bound("fibres")], ["fibres"], None, [], **FACTS).named == ("tilt",)
    assert told([finding(**WEAK)], [], at_bound("stiffness"), [], **FACTS).named == ()


def test_of_two_base_parameters_the_one_that_explains_more_by_itself_is_named():
    """Beside stiffness, which is always fitted along, another parameter has less left to explain."""
    base = finding("stiffness", gain=0.45, alone=0.45)
    damping = finding("damping", gain=0.3, alone=0.62, alone_error=0.03)
    verdict = told([damping], [], base, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("BASE PARAMETER", ("damping",))
    verdict = told([replace(damping, **WEAK)], [], base, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("BASE PARAMETER", ("damping",))
    verdict = told([replace(damping, gain=0.1, alone=0.47)], [], base, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("BASE PARAMETER", ("stiffness",))
    assert "A change of damping would explain as much" in verdict.text
    assert verdict.evidence.alternatives == ("damping",)
    verdict = told([replace(damping, gain=0.1, alone=0.3)], [], base, [], **FACTS)
    assert verdict.named == ("stiffness",) and verdict.evidence.alternatives == ()


def test_a_second_does_not_inherit_what_the_first_may_not_have():
    assert told([finding("drag", gain=0.9), finding()], [], None, [], **FACTS).named == ()


@pytest.mark.parametrize(
    "change, reason",
    [
        ({"p": 0.03}, "p = 0.030"),
        ({"p": None}, "no permutation test"),
        ({"gain": 0.04, "gain_error": 0.001}, "gain 4.0 %"),
        ({"gain_error": 0.4}, "standard errors (40.0 %)"),
        ({"contrast": SAME}, "reference recordings"),
    ],
)
def test_each_condition_is_needed_and_said(change, reason):
    found = finding(**change)
    assert not found.passes()
    assert any(reason in text for text in _row(found, {}, None).why_not())
    assert told([found], [], None, [], **QUIET).kind == "NOTHING DETECTABLE"


def test_what_passes_has_no_reason_against_it():
    assert finding().passes() and finding().reasons() == []
    assert not at_bound().passes() and at_bound().reasons() == [Reason.AT_BOUND]


def test_a_law_that_does_more_than_the_base_parameter_by_itself_is_named():
    """Stiffness mimics the law so well that beside it the law has nothing left to explain."""
    verdict = told([finding(alone=0.8, alone_error=0.05, **WEAK)], [], finding("stiffness", gain=0.5), [], **FACTS)
    assert (verdict.kind, verdict.named) == ("EFFECT", ("tilt",))
    assert "80 % of the held-out error" in verdict.text


def test_a_law_that_does_as_much_as_the_base_parameter_cannot_be_told_from_it():
    verdict = told([finding(alone=0.55, alone_error=0.05, **WEAK)], [], finding("stiffness"), [], **FACTS)
    assert (verdict.kind, verdict.named) == ("CONFOUNDED", ("stiffness", "tilt"))
    same = {"alone": 0.55, "alone_error": 0.05, **WEAK}
    for rival in (replace(at_bound(), **same), finding("drag", **same)):
        assert told([rival], [], finding("stiffness"), [], **FACTS).named == ("stiffness",)


def test_a_law_that_explains_much_beyond_the_base_parameter_is_named():
    verdict = told([finding(gain=0.7, alone=0.3)], [], finding("stiffness", gain=0.4), [], **FACTS)
    assert (verdict.kind, verdict.named) == ("EFFECT", ("tilt",))
    verdict = told([finding(gain=0.2, alone=0.3)], [], finding("stiffness", gain=0.6), [], **FACTS)
    assert (verdict.kind, verdict.named) == ("BASE PARAMETER", ("stiffness",))


def test_a_law_that_one_episode_alone_carries_does_not_stand_before_one_that_all_show():
    alone = finding("adhesion", gain=0.7, steady=0.01)
    verdict = told([alone, finding(gain=0.3)], [], None, [], **FACTS)
    assert (verdict.kind, verdict.named) == ("EFFECT", ("tilt",))
    assert first_of([alone, finding("tilt", contrast=SAME), finding("fibres")]) == 2
    assert first_of([alone]) is None
    assert told([alone], [], None, [], **FACTS).kind == "NONE OF THESE"


def test_a_law_that_one_episode_alone_carries_is_told_with_the_episode():
    alone = finding("adhesion", gain=0.7, steady=0.01, helps="press_3")
    for size, kind in ((FACTS, "NONE OF THESE"), (QUIET, "NOTHING DETECTABLE")):
        verdict = told([alone, finding("fibres", **WEAK)], [], None, [], **size)
        assert (verdict.kind, verdict.named) == (kind, ())
        assert "adhesion takes 70 % of the held-out error away, but press_3 alone shows it" in verdict.text
        assert verdict.evidence.lone == Lone("adhesion", "press_3")
        ended = replace(alone, parameters=at_bound().parameters)
        assert told([ended], [], None, [], **size).evidence.lone == verdict.evidence.lone
    for other in (replace(alone, p=0.4), finding("drag", gain=0.7, steady=0.01, helps="press_3")):
        verdict = told([other], [], None, [], **FACTS)
        assert verdict.evidence.lone is None and "press_3" not in verdict.text


def test_a_base_parameter_that_leaves_most_of_the_gap_needs_an_error_that_stands_out():
    facts: dict[str, Any] = {"error": 3.2, "floor": 1.2, "left": 2.4, "excess_p": 0.004}
    assert told([finding("damping")], [], None, [], **facts, excess=2.2).kind == "NOTHING DETECTABLE"
    verdict = told([finding("damping")], [], None, [], **facts, excess=4.0)
    assert (verdict.kind, verdict.named) == ("PARTLY", ("damping",))
    facts["left"] = 1.5
    assert told([finding("damping")], [], None, [], **facts, excess=2.2).kind == "BASE PARAMETER"


def test_a_law_that_is_refused_does_not_hide_the_base_parameter():
    """The law takes away more than half as much again, but leaves too much of a gap that may be chance."""
    law, stiffness = finding(gain=0.8), finding("stiffness", gain=0.6)
    size = {"error": 1.4, "floor": 1.0, "raw": 3.0, "left": 1.3, "excess": 1.0, "excess_p": 0.3}
    assert told([law], [], None, [], **size).kind == "NOTHING DETECTABLE"
    verdict = told([law], [], stiffness, [], **size)
    assert (verdict.kind, verdict.named) == ("BASE PARAMETER", ("stiffness",))
    # a parameter that leaves most of such a gap is refused for the same reason
    assert told([law], [], stiffness, [], **{**size, "raw": 1.6}).kind == "NOTHING DETECTABLE"
    # and a law that is not refused is still named
    assert told([law], [], stiffness, [], **{**size, "left": 1.1}).named == ("tilt",)


NONE = Verdict(
    VerdictKind.NONE_OF_THESE, (), "Something is missing that the library does not hold.", Grounds(excess=9.0)
)


def test_two_laws_are_named_where_only_both_explain_it():
    size = ErrorSize(raw=20.0, error=11.0, floor=1.0, excess=9.0)
    both = finding("adhesion", gain=0.8), finding("tilt", gain=0.7)
    verdict = judge_pair(NONE, *both, 2.0, size)
    assert (verdict.kind, verdict.named) == ("EFFECT", ("adhesion", "tilt"))
    assert "both close 90 % of the explainable gap" in verdict.text and "which were fitted together" in verdict.text
    assert verdict.evidence.left == 2.0 and verdict.evidence.alone.kind == "NONE OF THESE"
    verdict = judge_pair(NONE, *both, 4.0, size)
    assert (verdict.kind, verdict.named) == ("PARTLY", ("adhesion", "tilt")) and verdict.text.startswith("Partly")


@pytest.mark.parametrize(
    ("changes", "left", "floor"),
    [
        ({}, 6.0, 1.0),
        ({}, 2.0, None),
        (WEAK, 2.0, 1.0),
        ({"gain": 0.08, "gain_error": 0.01}, 2.0, 1.0),
        ({"contrast": SAME}, 2.0, 1.0),
        ({"kind": "decoy"}, 2.0, 1.0),
    ],
)
def test_two_laws_of_which_one_fails_a_test_change_nothing(changes, left, floor):
    size = ErrorSize(raw=20.0, error=11.0, floor=floor, excess=9.0)
    assert judge_pair(NONE, finding("adhesion"), finding("tilt", **changes), left, size) is NONE
    assert judge_pair(NONE, finding("adhesion", **changes), finding("tilt"), left, size) is NONE
