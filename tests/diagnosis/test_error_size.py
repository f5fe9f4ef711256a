"""Whether the base's error here exceeds that where nothing is missing by more than chance."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from plop.diagnosis.error_size import ErrorSize, exceeded_within, exchanged


def test_permutations_count_every_deal():
    ours, theirs = np.array([30.0, 40.0, 1.0, 1.2]), np.array([1.0, 1.1, 0.9, 1.2, 0.8, 1.0, 1.3, 0.7])
    deals = [sum(deal) >= ours.sum() - 1e-9 for deal in combinations([*ours, *theirs], 4)]
    assert exchanged(ours, theirs) == pytest.approx(np.mean(deals), abs=0.01)
    assert exchanged(theirs[:4], theirs[4:]) > 0.2


def test_one_kind_of_motion_that_goes_wrong_is_seen_beside_kinds_that_differ():
    """Few episodes of a kind exceed their counterparts clearly, and all others hide it where kinds are mixed."""
    generator = np.random.default_rng(0)
    kinds, their_kinds = [*"ppccmm"], [*"pppcccmmm"]
    level = {"p": 2.0, "c": 0.0, "m": 1.0}
    theirs = np.array([level[k] + generator.normal(0, 0.15) for k in their_kinds])
    ours = np.array([level[k] + generator.normal(0, 0.15) + (1.0 if k == "c" else 0.0) for k in kinds])
    assert exceeded_within(ours, theirs, kinds, their_kinds) < 0.001
    assert exchanged(np.exp(ours), np.exp(theirs)) > 0.05
    found = ErrorSize.of(np.exp(ours), 9.0, np.exp(theirs), (kinds, their_kinds))
    assert found.excess_p is not None and found.excess_p < 0.002


def test_equal_errors_rarely_exceed_within_kinds():
    generator, kinds = np.random.default_rng(1), [*"ppccmm"]
    chances = [
        exceeded_within(generator.normal(size=6), generator.normal(size=12), kinds, kinds * 2) for _ in range(400)
    ]
    assert np.mean(np.array(chances) <= 0.05) < 0.07
