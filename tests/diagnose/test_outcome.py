"""What is kept of a diagnosis' rows: whether parameters are determined, and no share below nothing in its table."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.decision.finding import Finding
from plop.diagnosis.decision.result import Diagnosis, Ranked
from plop.diagnosis.evidence.amounts import Contrast
from plop.diagnosis.evidence.contrast import Products
from plop.diagnosis.responses.hypotheses import candidates_of, hypotheses_of
from plop.diagnosis.scores.score import Score
from plop.parameters import NOT_DETERMINED, Estimate
from plop.physics.effects.library import EffectType, library
from stages.diagnose import outcome
from stages.diagnose.outcome import rows_of
from tests.support.diagnoses import diagnosis, verdict


def finding(name: str, low: float, high: float, gain: float = 0.5, **more: Estimate) -> Finding:
    kind = library(())[name]
    [first, *_] = kind.amplitudes
    value = Estimate((low + high) / 2, low, high, first.unit)
    [candidate, *_] = [c for c in candidates_of(library(()), [name]) if c.effect == name]
    [hypothesis, *_] = hypotheses_of([candidate])
    none = np.zeros(4)
    known, gains = Contrast(np.ones(1), np.full((1, 1), 0.01), 3), none + gain
    explained, directed = (none + 1, gains), lambda: known
    score = Score(hypothesis, Products(np.eye(4), none), 1.0, directed, 0.005, gains, 4, 1e-3, lambda: explained)
    return Finding(name, kind.kind, {first.name: value, **more}, score, gain, 0.1, ())


def _row(found: Finding, types: dict[str, EffectType]) -> Ranked:
    return outcome._row(found, types, found.score.gains)


def test_rows_say_what_the_recordings_determine_by_the_range_of_each_law():
    tried = Estimate(0.1, unit="s", alternatives=(0.03, 0.3), fitted=False)
    open_ended = _row(finding("adhesion", 184.0, 7890.0, release_s=tried), library(())).parameters
    assert not open_ended["traction_pa"].determined and not open_ended["release_s"].determined
    alone = replace(tried, alternatives=())
    known = _row(finding("adhesion", 184.0, 700.0, release_s=alone), library(())).parameters
    assert known["traction_pa"].determined and known["release_s"].determined
    assert _row(finding("tilt", 0.1, 0.2), {}).parameters["gx_m_s2"].determined, "a law of the user's"


def test_the_table_says_why_a_law_that_is_certain_is_not_named():
    row = _row(finding("tilt", 0.1, 0.2), library(()))
    why = {kind: rows_of(diagnosis(verdict(kind), row))[0]["verdict"] for kind in ("NONE OF THESE", "SENSOR")}
    assert why == {"NONE OF THESE": "explains too little", "SENSOR": "passes"}


def test_the_table_says_that_a_law_does_not_help_instead_of_minus_200_per_cent():
    rows = [_row(finding("adhesion", 184.0, 7890.0), library(()))]
    rows.append(_row(finding("tilt", 0.1, 0.2, gain=-2.0), library(())))
    base = _row(finding("stiffness", -0.1, 0.2, gain=-1.5), library(()))
    shown = rows_of(diagnosis(verdict("EFFECT", "adhesion"), *rows, base))
    assert [row["explains"] for row in shown] == ["50.0 ± 10.0 %", "does not help", "does not help"]
    assert NOT_DETERMINED in shown[0]["parameter"] and NOT_DETERMINED not in shown[1]["parameter"]
    assert not any(re.search(r"-\d", reason) for row in rows[1:] for reason in row.why_not())


@pytest.mark.parametrize(
    ("spoil", "where"),
    [
        (lambda facts: facts["verdict"].pop("kind"), "verdict.kind"),
        (lambda facts: facts["verdict"].update(kind="EFFEKT"), "verdict.kind"),
        (lambda facts: facts["ranking"][0].update(gain="much"), "ranking.0.gain"),
        (lambda facts: facts["ranking"][0].update(reasons=["because"]), "ranking.0.reasons.0"),
        (lambda facts: facts["ranking"][0]["parameters"]["gx_m_s2"].pop("value"), "ranking.0.parameters.gx_m_s2"),
        (lambda facts: facts.update(ranking={}), "ranking"),
        (lambda facts: facts.update(schema=1), "diagnosis.json"),
    ],
)
def test_what_is_wrong_in_a_file_is_named_by_its_place(spoil, where):
    from plop.errors import PlopError

    facts = diagnosis(verdict("EFFECT", "tilt"), _row(finding("tilt", 0.1, 0.2), library(()))).to_json()
    assert Diagnosis.from_json(facts).ranking[0].effect == "tilt"
    spoil(facts)
    with pytest.raises(PlopError) as caught:
        Diagnosis.from_json(facts)
    assert str(caught.value.where).endswith(where) and "`plop diagnose`" in caught.value.fix
