"""All laws are run with few particles first; what is reported is what the engine itself answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.decision.amplitude import _step
from plop.diagnosis.diagnose import diagnose, survey_of
from plop.diagnosis.responses.job import Answer, Job
from plop.physics.effects.library import library
from tests.diagnosis.test_diagnose import LAWS, Fields, finding
from tests.support.coarse_episodes import BASE, coarse_episode

FINE = replace(BASE, spacing_m=0.003)


class Surveyed(Fields):
    """With few particles every law does 1.5 times as much."""

    def __init__(self, follows: bool = True) -> None:
        super().__init__()
        self.follows, self.surveyed, self.full = follows, list[str](), list[str]()

    def run(self, jobs: list[Job]) -> list[Answer]:
        found = []
        for job, answer in zip(jobs, super().run(jobs), strict=True):
            coarse = job.base.spacing_m > 1.2 * FINE.spacing_m
            laws = self.surveyed if coarse else self.full
            laws += [job.settings[0][0].effect] if job.settings else []
            plain = self.plain(job.episode)
            points = plain + (1.5 if coarse else 1.0) * (answer.points - plain)
            found.append(Answer(None, "unstable") if coarse and not self.follows else Answer(points))
        return found

    def named(self, hidden: dict[str, float]):
        there, reference = self.measured(1, hidden), self.measured(2, {})
        return diagnose(there, FINE, library(), self.run, reference=reference, effects=LAWS)


def test_what_is_reported_is_the_answer_of_the_engine_itself():
    world = Surveyed()
    found = world.named({"swelling": 0.06})
    assert found.verdict.named == ("swelling",)
    assert finding(found, "swelling").parameters["rate_per_s"].value == pytest.approx(0.06, rel=0.05)
    assert {*LAWS} <= {*world.surveyed}
    laws = {*world.full} - {"stiffness", "damping", "table_friction", "blade_friction"}  # the base's own
    assert laws == {"swelling"}, "the others are far from being the best"


def test_a_second_law_is_that_of_the_engine_itself_too():
    found = Surveyed().named({"swelling": 0.08, "viscosity": 60.0})
    assert {*found.verdict.named} == {"swelling", "viscosity"}, found.verdict
    assert finding(found, "viscosity").parameters["viscosity_pa_s"].value == pytest.approx(60.0, rel=0.15)


def test_where_nothing_is_hidden_the_survey_is_enough():
    world = Surveyed()
    assert world.named({}).verdict.kind == "NOTHING DETECTABLE"
    assert {*world.full} <= {"stiffness", "damping", "table_friction", "blade_friction"}


def test_a_survey_that_cannot_follow_an_episode_is_not_used():
    world = Surveyed(follows=False)
    found = world.named({"swelling": 0.06})
    assert found.verdict.named == ("swelling",) and "unstable" not in found.dropped.values()
    assert not world.surveyed and {*LAWS} <= {*world.full}


def test_an_engine_of_few_particles_is_its_own_survey():
    episodes = [coarse_episode(1)]
    survey = survey_of(FINE, episodes)
    assert survey is not None and survey.material == FINE.material and survey.spacing_m > FINE.spacing_m
    assert survey_of(survey, episodes) is None
    assert survey_of(replace(survey, spacing_m=survey.spacing_m / 1.1), episodes) is None


def test_the_next_amplitude_is_in_proportion_or_between_two_that_say_more_and_less():
    assert _step([(0.0, np.log(3))]) == pytest.approx(np.log(3))
    assert _step([(0.0, np.log(3)), (1.0, np.log(1.5))]) == pytest.approx(np.log(1.5))
    tried = [(0.0, 2.0), (1.0, -1.0)]
    assert tried[-1][0] + _step(tried) == pytest.approx(2 / 3)
    assert 2.0 + _step([(0.0, 2.0), (1.0, 1.0), (2.0, -1.0)]) == pytest.approx(1.5), "of the nearest two"
