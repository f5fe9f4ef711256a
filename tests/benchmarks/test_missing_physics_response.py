"""The engine's response beside the true one: responses of known size."""

from __future__ import annotations

import pytest

from benchmarks.missing_physics.response import response_error
from plop.comparison.discretisations import discretised
from plop.diagnosis.responses import Answer, Job
from plop.physics.effects.library import effect_type
from tests.support.coarse_episodes import BASE, coarse_episode

MEMBERS = discretised(BASE)


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
