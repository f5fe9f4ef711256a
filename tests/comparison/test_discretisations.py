"""An engine is judged by its mean over discretisations, and by how far these differ."""

from __future__ import annotations

import numpy as np
import pytest

from plop.comparison import discretisations
from plop.comparison.discretisations import OTHERS, discretised, predicted_by_each
from plop.diagnosis.evidence.evidence import evidence_of
from plop.diagnosis.responses.hypotheses import Hypothesis, candidates_of
from plop.diagnosis.responses.job import Answer, Job
from plop.diagnosis.responses.table import Measured, Table
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import library
from plop.physics.engine.material import Material
from plop.tracking.episode import Episode
from tests.support.coarse_episodes import coarse_episode

BASE = EngineBase(Material(), spacing_m=0.01)
[CANDIDATE] = [c for c in candidates_of(library(), ["tilt"]) if c.effect == "tilt"]
COLUMN = CANDIDATE.columns[0]
SHIFTS = {1.0: 0.0, 0.86: 3e-3, 1.16: -1e-3}
"""Distance of the particles, in units of the base's -> how far that discretisation moves all points by the end [m]."""


@pytest.fixture(scope="module")
def episode() -> Episode:
    return coarse_episode(0)


def share_of(base: EngineBase) -> float:
    return round(base.spacing_m / BASE.spacing_m, 6)


def moved(episode: Episode, shift_m: float) -> np.ndarray:
    ramp = np.linspace(0, 1, len(episode.times))[:, None, None]
    return episode.points[:1] + shift_m * ramp * np.array([1.0, 0, 0])


def answers(jobs: list[Job]) -> list[Answer]:
    return [Answer(moved(job.episode, SHIFTS[share_of(job.base)])) for job in jobs]


def test_the_engine_itself_comes_first_and_cells_follow_the_particles():
    members = discretised(BASE)
    assert members[0] is BASE
    assert [share_of(member) for member in members[1:]] == list(OTHERS)
    assert [member.config.dx_m / member.spacing_m for member in members] == pytest.approx([2.0] * 3)


def test_an_engine_as_base_says_the_mean_and_is_as_unsure_as_they_differ(episode):
    table = Table(Measured([episode]), BASE, answers)
    found, mean = table.evidence[0], np.mean([moved(episode, s) for s in SHIFTS.values()], 0)
    np.testing.assert_allclose(found.residual, evidence_of(episode, [mean]).residual, atol=1e-12)
    expected = np.std(list(SHIFTS.values()), ddof=1) / np.sqrt(3)  # of three coordinates one differs
    assert found.spread_m[-1] == pytest.approx(np.full(episode.patches, expected))
    np.testing.assert_array_equal(table.plain[0][0], moved(episode, 0.0))


def test_a_discretisation_that_fails_is_left_out_and_the_engine_itself_is_not(episode):
    def spoilt(share: float):
        return lambda jobs: [
            Answer(None, "unstable") if share_of(job.base) == share else answer
            for job, answer in zip(jobs, answers(jobs), strict=True)
        ]

    found = Table(Measured([episode]), BASE, spoilt(0.86)).plain[0]
    np.testing.assert_array_equal(found, [moved(episode, 0.0), moved(episode, SHIFTS[1.16])])
    with pytest.raises(PlopError, match="can follow no episode"):
        Table(Measured([episode]), BASE, spoilt(1.0))


def test_a_base_with_one_prediction_is_run_in_one_discretisation(episode):
    asked: list[Job] = []

    def noted(jobs: list[Job]) -> list[Answer]:
        asked.extend(jobs)
        return answers(jobs)

    table = Table(Measured([episode], {episode.name: [episode.points]}), BASE, noted)
    assert [job.base for job in asked] == [BASE]
    assert np.abs(table.evidence[0].residual).max() < 1e-12
    assert not table.evidence[0].spread_m.any()


def test_a_response_is_the_engine_s_own_and_a_run_that_fails_is_not_used(episode):
    def run(jobs: list[Job]) -> list[Answer]:
        return [
            Answer(None, "unstable")
            if any(v > 1 for _, v in job.settings)
            else Answer(moved(job.episode, SHIFTS[share_of(job.base)] + sum(2 * v for _, v in job.settings)))
            for job in jobs
        ]

    for given in (None, {episode.name: [episode.points]}):
        table = Table(Measured([episode], given), BASE, run)
        one, two = (Hypothesis(CANDIDATE, (v, 0.0), ((((COLUMN, v),), 0.5),)) for v in (1.0, 2.0))
        table.respond([one, two])
        assert table.response(one)[0][-1, 0, 0] == pytest.approx(0.5 * 2.0)
        assert table.trouble(one) is None and table.trouble(two) == "unstable"


def test_effects_go_along_in_every_discretisation(episode, monkeypatch):
    def run(base, episode, start, effects):
        if share_of(base) in broken:
            raise PlopError("The engine is unstable.")
        return moved(episode, SHIFTS[share_of(base)] + len(effects))

    monkeypatch.setattr(discretisations, "start_particles", lambda base, episode, effects: None)
    monkeypatch.setattr(discretisations, "predict_points", run)
    broken: set[float] = {1.16}
    found = predicted_by_each(BASE, episode, ["law"])  # type: ignore[list-item]
    np.testing.assert_array_equal(found, [moved(episode, 1.0), moved(episode, 1.0 + SHIFTS[0.86])])
    broken = {1.0}
    with pytest.raises(PlopError, match="unstable"):
        predicted_by_each(BASE, episode, [])
