"""The benchmark of the mean over discretisations: errors, scatter and responses of known size."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.discretisations import predictions
from benchmarks.physics_response import response_error
from plop.comparison.discretisations import discretised
from plop.diagnosis.responses import Answer, Job
from plop.physics.effects.library import effect_type
from tests.support.coarse_episodes import BASE, coarse_episode

MEMBERS = discretised(BASE)


def shifted(job: Job, shift_m: float) -> Answer:
    ramp = np.linspace(0, 1, len(job.episode.times))[:, None, None]
    return Answer(job.episode.points + shift_m * ramp * np.array([1.0, 0, 0]))


def test_errors_of_opposite_sign_leave_the_mean_and_are_its_scatter():
    shifts = dict(zip((m.spacing_m for m in MEMBERS), (0.0, 3e-3, -3e-3), strict=True))
    found = predictions([coarse_episode(0)], BASE, lambda jobs: [shifted(j, shifts[j.base.spacing_m]) for j in jobs])  # type: ignore[arg-type]
    assert found["alone_mm"] == pytest.approx(0, abs=1e-9) == found["mean_mm"]
    assert found["spread_mm"] > 1
    one = predictions([coarse_episode(0)], BASE, lambda jobs: [shifted(j, 3e-3 * (j.base is BASE)) for j in jobs])  # type: ignore[arg-type]
    assert one["mean_mm"] == pytest.approx(one["alone_mm"] / 3)
    assert one["mean_worst_mm"] == pytest.approx(one["mean_mm"]) and one["episodes"] == 1


def test_a_response_twice_as_strong_in_one_discretisation_and_true_in_the_others():
    effect = effect_type("tilt")(gx_m_s2=1.0)
    plain = [coarse_episode(0)]
    hidden = [coarse_episode(0, "tilt", 1.0)]
    change = (hidden[0].points - plain[0].points) - (hidden[0].points - plain[0].points)[:1]

    def run(jobs: list[Job]) -> list[Answer]:
        return [Answer(job.episode.points + bool(job.settings) * (1 + (job.base is BASE)) * change) for job in jobs]

    alone = response_error(effect, hidden, plain, MEMBERS[:1], run)  # type: ignore[arg-type]
    mean = response_error(effect, hidden, plain, MEMBERS, run)  # type: ignore[arg-type]
    assert alone == pytest.approx({"size": 2.0, "cosine": 1.0}) and mean == pytest.approx(
        {"size": 4 / 3, "cosine": 1.0}
    )
    assert response_error(effect, hidden, plain, MEMBERS, lambda jobs: [Answer(None)] * len(jobs)) is None  # type: ignore[arg-type]
