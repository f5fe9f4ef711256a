"""What was noticed before a failure survives it, and the first cause stands in front of the last symptom."""

from __future__ import annotations

import pickle

import pytest

from plop.causes import Cause, Noticed, by_cause
from plop.errors import PlopError, UserCodeError, remembering

TORN = Noticed("cameras a and b see the object 90 mm apart", Cause.EXTRINSICS, "Check the extrinsics.")
LATE = Noticed("pictures are 700 ms late", Cause.CLOCK, "Check the clocks.")
ASIDE = "no table_z is given"


def failed(*warnings: str, cause: Cause | None = Cause.TOUCH) -> PlopError:
    with pytest.raises(PlopError) as caught, remembering(warnings):
        raise PlopError("It never touches.", where="e1", found="253 mm", fix="Check the tool.", cause=cause)
    return caught.value


def test_warnings_survive_and_are_printed():
    error = failed(ASIDE, TORN)
    assert error.noticed == [ASIDE, TORN]
    for text in (error.render(), str(error), error.one_line()):
        assert ASIDE in text and TORN in text and "253 mm" in text
    assert error.as_dict()["noticed"] == [ASIDE, TORN]
    assert "noticed" not in PlopError("x").as_dict()


def test_warnings_gathered_inside_and_outside_come_in_order_and_once():
    inner: list[str] = []
    with pytest.raises(UserCodeError) as caught, remembering([ASIDE]), remembering([ASIDE, *inner]):
        with remembering(inner):
            inner.append(TORN)
            raise UserCodeError("no")
    assert caught.value.noticed == [ASIDE, TORN]


def test_the_earliest_cause_leads_and_the_symptom_follows_with_its_advice():
    lead = failed(TORN, ASIDE, LATE).first_cause()
    assert lead.problem == "Pictures are 700 ms late"
    assert "It never touches. Found: 253 mm" in (lead.found or "")
    assert lead.fix == "Check the clocks. If the problem persists: Check the tool."
    assert lead.noticed == [TORN, ASIDE]
    assert lead.where == "e1"


@pytest.mark.parametrize(
    "error",
    [
        failed(),
        failed(ASIDE),
        failed(TORN, cause=None),
        failed(TORN, cause=Cause.EXTRINSICS),
        failed(TORN, cause=Cause.CLOCK),
    ],
)
def test_a_warning_that_cannot_explain_a_failure_does_not_take_its_place(error):
    assert error.first_cause() is error


def test_causes_sort_first_and_equals_keep_their_order():
    other = Noticed("a third camera", Cause.EXTRINSICS)
    assert by_cause([ASIDE, TORN, LATE, other, TORN]) == [LATE, TORN, other, ASIDE]


def test_what_comes_from_another_process_keeps_what_it_knows():
    error = pickle.loads(pickle.dumps(failed(TORN)))  # noqa: S301 - our own bytes
    assert error.first_cause().problem == TORN[:1].upper() + TORN[1:]
    assert error.noticed[0].fix == TORN.fix
