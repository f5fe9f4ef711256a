"""An engine is judged by its mean over discretisations, and by how far these differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.comparison import discretisations
from plop.comparison.discretisations import OTHERS, discretised, predicted_by_each
from plop.diagnosis.evidence import MisfitModel, evidence_of
from plop.diagnosis.responses import Answer, Job
from plop.diagnosis.table import Measured, Table
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.engine.material import Material
from plop.tracking.episode import Episode
from tests.support.coarse_episodes import coarse_episode
from tests.support.synthetic_evidence import candidate, episodes, state

BASE = EngineBase(Material(), spacing_m=0.01)
COLUMN = candidate("tilt").columns[0]
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
    found, mean = table.evidence()[0], np.mean([moved(episode, s) for s in SHIFTS.values()], 0)
    np.testing.assert_allclose(found.residual, evidence_of(episode, [mean], {}).residual, atol=1e-12)
    expected = np.std(list(SHIFTS.values()), ddof=1) / np.sqrt(3)  # of three coordinates one differs
    assert found.spread_m[-1] == pytest.approx(np.full(episode.patches, expected))
    np.testing.assert_array_equal(table.plain[0], moved(episode, 0.0))


def test_a_discretisation_that_fails_is_left_out_and_the_engine_itself_is_not(episode):
    def spoilt(share: float):
        return lambda jobs: [
            Answer(None, "unstable") if share_of(job.base) == share else answer
            for job, answer in zip(jobs, answers(jobs), strict=True)
        ]

    found = Table(Measured([episode]), BASE, spoilt(0.86)).predictions[0]
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
    assert np.abs(table.evidence()[0].residual).max() < 1e-12
    assert not table.evidence()[0].spread_m.any()


def test_responses_are_the_mean_over_discretisations_where_that_is_asked_for(episode):
    strength = {1.0: 2.0, 0.86: 1.0, 1.16: 4.5}

    def run(jobs: list[Job]) -> list[Answer]:
        return [
            Answer(
                moved(
                    job.episode,
                    SHIFTS[share_of(job.base)] + sum(v for _, v in job.settings) * strength[share_of(job.base)],
                )
            )
            for job in jobs
        ]

    def slope(table: Table) -> float:
        return float(table.responses[0][COLUMN.key][-1, 0, 0])

    for given in (None, {episode.name: [episode.points]}):
        table = Table(Measured([episode], given), BASE, run)
        table.respond([COLUMN])
        assert slope(table) == pytest.approx(2.0)
        table.respond([COLUMN], everywhere=True)
        assert slope(table) == pytest.approx(np.mean(list(strength.values())))


def test_a_response_leaves_out_the_discretisation_that_fails_under_the_law(episode):
    def run(jobs: list[Job]) -> list[Answer]:
        return [
            Answer(None, "unstable")
            if job.settings and share_of(job.base) in broken
            else Answer(moved(job.episode, sum(v for _, v in job.settings)))
            for job in jobs
        ]

    broken = {0.86}
    table = Table(Measured([episode]), BASE, run)
    table.respond([COLUMN], everywhere=True)
    assert table.responses[0][COLUMN.key][-1, 0, 0] == pytest.approx(1.0)
    broken = {1.0}
    table.respond([COLUMN], everywhere=True)
    assert not table.responses[0] and table.dropped == {COLUMN.key: "unstable"}


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


def test_what_the_engine_is_unsure_of_weighs_less():
    def unsure(seed: int, count: int) -> list:
        drawn = np.random.default_rng(seed)
        found = []
        for e in episodes(seed, count=count):
            spread = drawn.uniform(0, 1e-3, e.spread_m.shape)
            noise = drawn.normal(size=e.residual.shape) * spread[..., None]
            found.append(replace(e, spread_m=spread, residual=e.residual + noise))
        return found

    model, fresh = MisfitModel.of(unsure(1, 20)), unsure(2, 20)
    squares: dict[bool, list[float]] = {True: [], False: []}
    for e in fresh:
        white, unsure_half = (e.residual / model.sigma(e)) ** 2, e.spread_m > np.median(e.spread_m)
        for half, found in squares.items():
            found.append(white[unsure_half == half].mean())
    for found in squares.values():
        assert np.mean(found) == pytest.approx(1, abs=0.15)


def test_without_a_reference_doubt_follows_the_motion_alone():
    def unsure(seed: int) -> list:
        drawn = np.random.default_rng(seed)
        return [replace(e, spread_m=drawn.uniform(0, 1e-2, e.spread_m.shape)) for e in episodes(seed)]

    plain = episodes(1)
    np.testing.assert_array_equal(state(unsure(1)).misfit.doubt_m, state(plain).misfit.doubt_m)
    assert state(unsure(1), unsure(2)).misfit.doubt_m[-1] > 2 * state(plain, episodes(2)).misfit.doubt_m[-1]


def test_amplitudes_that_act_together_share_what_they_do_beyond_their_sum(episode):
    both = [replace(COLUMN, amplitude=name, value=value) for name, value in (("x", 2.0), ("y", -0.5))]

    def run(jobs: list[Job]) -> list[Answer]:
        found = []
        for job in jobs:
            x, y = ({c.amplitude: v for c, v in job.settings}.get(name, 0.0) for name in "xy")
            far = abs(x * y) > limit
            found.append(Answer(None, "unstable") if far else Answer(moved(job.episode, 3 * x + y + x * y)))
        return found

    for everywhere in (False, True):
        limit = 9.0
        table = Table(Measured([episode]), BASE, run)
        table.respond_together(both, everywhere=everywhere)
        x, y = (float(table.responses[0][column.key][-1, 0, 0]) for column in both)
        assert (x, y) == pytest.approx((3 - 0.5 / 2, 1 + 2.0 / 2))  # half of -1, the product, per unit of each
        assert 2.0 * x - 0.5 * y == pytest.approx(6 - 0.5 - 1)
        limit = 0.5
        table.respond_together(both, everywhere=everywhere)
        assert not table.responses[0] and set(table.dropped) == {column.key for column in both}
