"""Ranking: the planted law comes first, its gain has an honest error, and look-alikes are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.regression import gain, held_out_energy
from plop.diagnosis.screen import confounded, one_per_effect
from plop.diagnosis.state import State
from tests.support.synthetic_evidence import LAWS, candidate, episodes, key, screen, state


@pytest.mark.parametrize("law", [name for name in LAWS if name != "stiffness"])
def test_planted_law_ranks_first_with_its_amplitude(law):
    found = state(episodes(1, {law: 0.3, "stiffness": 0.2})).scores()[0]
    assert found.candidate.effect == law
    assert found.values[0] == pytest.approx(0.3, abs=3 * found.errors[0] + 0.01)
    assert found.errors[0] < 0.03


def test_stiffness_is_nobodys_gain():
    scores = state(episodes(2, {"stiffness": 1.0})).scores()
    assert all(score.gain < 0.02 for score in scores)
    assert "stiffness" not in {score.candidate.effect for score in scores}


def misled(seed: int) -> State:
    """Nothing is hidden, but one episode errs strongly along stiffness and a law together; both ask for the others'."""
    quiet, loud = episodes(seed, count=5), episodes(seed + 1, {"stiffness": 2.0, "viscosity": -1.5}, count=1)
    return state([*quiet, replace(loud[0], name="loud")])


def test_what_only_takes_back_a_misled_refit_of_the_base_gains_nothing():
    now = misled(20)
    raw, refitted = now.screen.grams.energy.sum(), now.screen.refitted().sum()
    assert refitted > 1.05 * raw, "the episode misleads the base's parameters"
    assert now.screen.before().sum() == raw == pytest.approx(now.size.error * now.numbers, rel=0.01)
    for score in now.scores():
        assert score.gain == pytest.approx(1 - score.after.sum() / raw)
    loud = state(episodes(20, {"stiffness": 0.5}))
    assert loud.screen.before().sum() == loud.screen.refitted().sum() < loud.screen.grams.energy.sum()


def test_size_is_the_displacement_at_the_fitted_amplitude():
    now = state(episodes(3, {"tilt": 0.5}))
    best = now.scores()[0]
    assert best.size_m == pytest.approx(0.5 * now.response_rms_m(key("tilt")), rel=0.1)


def test_a_law_without_any_response_is_no_candidate():
    data = [replace(e, responses={**e.responses, key("tilt"): 0 * e.residual}) for e in episodes(4)]
    assert "tilt" not in {c.effect for c in screen(data).candidates}


def test_parts_add_up_to_the_held_out_error():
    now = screen(episodes(5, {"tilt": 0.3}))
    rows = np.arange(3)
    np.testing.assert_allclose(now.held_out_blocks(rows).sum(1), held_out_energy(now.grams, rows), rtol=1e-9)


def test_gain_error_agrees_with_a_bootstrap_over_parts():
    now = screen(episodes(6, {"tilt": 0.08}))
    rows = np.array([now.index[key("stiffness")], now.index[key("tilt")]])
    before, after = now.held_out_blocks(now.base), now.held_out_blocks(rows)
    generator = np.random.default_rng(0)
    gains = []
    for _ in range(2000):  # episodes are strata: parts are drawn within each
        drawn = generator.integers(0, before.shape[1], before.shape)
        gains.append(np.take_along_axis(before - after, drawn, 1).sum() / before.sum())
    assert now.gain_error(now.base, rows) == pytest.approx(np.std(gains), rel=0.25)


def test_best_gain_is_that_of_the_ranking():
    now = state(episodes(7, {"swelling": 0.2}))
    assert now.screen.best_gain(now.screen.grams) == pytest.approx(now.scores()[0].gain)


def test_signatures_lie_outside_what_stiffness_can_do():
    now = state(episodes(8, {"tilt": 0.5}))
    score = now.scores()[0]
    signature = now.screen.signature(score.candidate, score.values)
    stiffness = np.concatenate([e.matrix[now.screen.base[0]] for e in now.screen.episodes])
    assert np.linalg.norm(signature) == pytest.approx(1)
    assert abs(signature @ stiffness) / np.linalg.norm(stiffness) < 1e-6


def twins(data, share: float):
    """Let fibres act like tilt, but for a share of their own."""
    alike = []
    for e in data:
        mixed = share * e.responses[key("fibres")] + (1 - share) * e.responses[key("tilt")]
        alike.append(replace(e, responses={**e.responses, key("fibres"): mixed}))
    return alike


def test_twins_are_confounded_and_others_are_not():
    now = state(twins(episodes(9, {"tilt": 0.3}), 0.05))
    scores = one_per_effect(now.scores())
    assert scores[0].candidate.effect in ("tilt", "fibres")
    other = {"tilt": "fibres", "fibres": "tilt"}[scores[0].candidate.effect]
    assert [s.candidate.effect for s in confounded(now.screen, scores[0], scores)] == [other]


def test_clear_cases_have_no_confounds():
    now = state(episodes(10, {"tilt": 0.3}))
    scores = now.scores()
    assert confounded(now.screen, scores[0], scores) == []


def test_best_setting_of_each_effect_is_kept():
    now = state(episodes(11, {"tilt": 0.3}))
    scores = now.scores()
    again = one_per_effect([*scores, replace(scores[0], gain=-1.0)])
    assert [s.candidate.effect for s in again] == [s.candidate.effect for s in scores]
    assert again[0].gain == scores[0].gain


def test_gain_counts_held_out_error_only():
    """Many useless columns fit any noise; on held-out episodes they make it worse."""
    laws = ("stiffness", *(f"law{k}" for k in range(12)))
    found = state(episodes(12, count=4, laws=laws), candidates=[candidate(name) for name in laws])
    grams = found.screen.grams
    everything = np.arange(len(laws))
    fitted = gain(grams.energy, held_out_energy(grams, everything))
    assert fitted < 0
