"""Which law is there, where some law is: the one that explains most, unless chance finds it easily."""

from __future__ import annotations

import numpy as np
import pytest

from plop.diagnosis.decision.conclusion import _strongest
from plop.diagnosis.decision.finding import Finding, finding_of
from plop.diagnosis.evidence.amounts import Contrast
from plop.diagnosis.evidence.contrast import Products
from plop.diagnosis.responses.hypotheses import candidates_of, hypotheses_of
from plop.diagnosis.rule import RULE
from plop.diagnosis.scores.score import Score
from plop.physics.effects.library import library


def found(law: str, p: float, gain: float) -> Finding:
    (candidate,) = [c for c in candidates_of(library(), [law]) if c.effect == law]
    hypothesis, none, gains = hypotheses_of([candidate])[0], np.zeros(4), np.full(4, gain)
    known, explained = Contrast(np.ones(1), np.full((1, 1), 0.01), 3), (none + 1, none + 0.5)
    score = Score(hypothesis, Products(np.eye(4), none), 1.0, lambda: known, p, gains, 4, 1e-3, lambda: explained)
    return finding_of(score, [])


@pytest.mark.parametrize(
    ("laws", "named"),
    [
        ([("damping", 0.03, 50.0), ("density", 0.001, 40.0)], "damping"),
        ([("damping", 0.2, 50.0), ("density", 0.001, 40.0)], "density"),
        ([("drag", 0.03, 50.0), ("density", 0.001, 40.0)], "density"),
        ([("drag", 0.001, 50.0), ("density", 0.001, 40.0)], "drag"),
        ([("damping", 0.03, 50.0), ("density", 0.02, 40.0)], None),
    ],
)
def test_of_laws_of_which_one_is_no_chance_the_one_that_explains_most_is_there(laws, named):
    first = _strongest([found(*law) for law in laws], RULE)
    assert (first and first.name) == named
    assert first is None or (first.stands and first.score.p == 0.001)
