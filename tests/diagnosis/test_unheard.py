"""Laws without a place in the ranking: those that move nothing, those that cannot be run, and a user's mistakes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.responses.hypotheses import Column
from plop.diagnosis.responses.job import Answer, Job, run_job
from plop.errors import PlopError, UserCodeError
from plop.physics.effects.library import library
from tests.support.coarse_episodes import BASE, coarse_episode
from tests.support.world import World


class Three(World):
    """Swelling moves points, adhesion does not; drag cannot be run where `broken` names it."""

    broken: tuple[str, ...] = ()

    def amounts(self, values):
        return [values.get("swelling", 0.0) * 20, values.get("drag", 0.0) / 100, values.get("stiffness", 0.0)]

    def run(self, jobs: list[Job]) -> list[Answer]:
        answers = super().run(jobs)
        fails = [any(column.effect in self.broken for column, _ in job.settings) for job in jobs]
        return [Answer(None, "unstable") if bad else answer for bad, answer in zip(fails, answers, strict=True)]


def test_a_law_that_moves_nothing_is_told_with_a_limit_that_nothing_reaches():
    found = Three().diagnosed({"swelling": 0.2}, ["swelling", "adhesion"])
    assert found.verdict.named == ("swelling",)
    assert "moves nothing" in found.dropped["adhesion"]
    assert found.limits["adhesion"].amplitude is None and found.limits["swelling"].amplitude is not None
    assert {f.name for f in found.findings} == {"swelling", "stiffness", "density", "damping"} - {*found.dropped}


def test_what_the_runs_are_for_is_told_before_they_are_made():
    world, steps = Three(), list[tuple[str, int]]()
    diagnose(
        world.measured(1, {"swelling": 0.2}),
        BASE,
        library(),
        world.run,
        reference=world.measured(2, {}),
        effects=["swelling"],
        announce=lambda step: steps.append((step, world.ran)),
    )
    assert [step for step, _ in steps] == ["no law", "every law", "amplitudes of the best"]
    assert [ran for _, ran in steps[:2]] == [0, 36]  # six episodes and six of the reference, in three discretisations


def test_a_law_with_one_setting_that_runs_can_be_judged():
    world = Three()
    run = world.run

    def one_fails(jobs):
        fails = [any("0.03" in column.key for column, _ in job.settings) for job in jobs]
        return [Answer(None, "unstable") if bad else answer for bad, answer in zip(fails, run(jobs), strict=True)]

    world.run = one_fails
    found = world.diagnosed({}, ["adhesion"])
    assert found.dropped["adhesion"].startswith("it moves nothing") and "adhesion" in found.verdict.text
    assert any("release_s=0.03" in key and why == "unstable" for key, why in found.dropped.items())


class OneWay(World):
    """A crust moves points only where it is added: none is there to be taken away."""

    def amounts(self, values):
        shrunk = values.get("swelling", 0.0)
        return [max(values.get("crust", 0.0), 0.0) / 0.7 - 20 * shrunk, 10 * shrunk]


def test_a_law_of_which_nothing_can_be_taken_away_keeps_its_place():
    found = OneWay().diagnosed({"swelling": 0.2}, ["swelling", "crust"])
    assert found.verdict.named == ("swelling",)
    assert "crust" in {f.name for f in found.findings} and "crust" not in found.dropped


def test_a_verdict_speaks_of_the_laws_that_were_tried():
    found = Three().diagnosed({}, ["swelling", "adhesion"])
    assert found.verdict.kind == "NOTHING DETECTABLE"
    assert "that were tried can be detected" in found.verdict.text and "swelling" in found.verdict.text
    whole = Three().diagnosed({}, library())
    assert "of the library" in whole.verdict.text


def test_a_law_that_cannot_be_run_is_told_and_not_among_those_tried():
    world = Three()
    world.broken = ("drag",)
    found = diagnose(world.measured(1, {}), BASE, library(), world.run, reference=world.measured(2, {}))
    assert found.dropped["drag"] == "unstable"
    assert "that were tried" in found.verdict.text and "drag" not in found.verdict.text
    world.broken = ("swelling", "drag")
    with pytest.raises(PlopError, match="No law could be judged") as caught:
        world.diagnosed({}, ["swelling", "drag"])
    assert "unstable" in str(caught.value.found)


@pytest.mark.parametrize("body", ["1 / 0", "raise SystemExit(0)", "body.v = None", "effect = type(self)(a=99.0)"])
def test_a_mistake_in_a_law_of_one_s_own_stops_the_diagnosis_with_its_line(tmp_path, body):
    path = tmp_path / "mine.py"
    path.write_text(
        "from plop.physics.effects.effect import Effect, Parameter\n\n\nclass Mine(Effect):\n"
        "    name = help = law = source = 'mine'\n"
        "    amplitudes = (Parameter('a', '-', -1.0, 1.0, step=0.1, typical=0.5),)\n\n"
        f"    def before(self, body, dt):\n        {body}\n"
    )
    column = Column("mine", "a", "-", (), 0.5, -1.0, 1.0)
    episode = replace(coarse_episode(0), seen=None)
    with pytest.raises(UserCodeError) as caught:
        run_job(Job(episode, BASE, ((column, 0.5),)), library([path]))
    assert "mine.py, line 8" in str(caught.value.where) or "mine.py, line 9" in str(caught.value.where)


def test_a_law_of_one_s_own_that_leaves_no_numbers_names_its_file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(
        "from plop.physics.effects.effect import Effect, Parameter\n\n\nclass Mine(Effect):\n"
        "    name = help = law = source = 'mine'\n"
        "    amplitudes = (Parameter('a', '-', -1.0, 1.0, step=0.1, typical=0.5),)\n\n"
        "    def before(self, body, dt):\n        body.v[0] = float('nan')\n"
    )
    column = Column("mine", "a", "-", (), 0.5, -1.0, 1.0)
    answer = run_job(Job(replace(coarse_episode(0), seen=None), BASE, ((column, 0.5),)), library([path]))
    assert answer.points is None and "mine.py, line 8" in answer.trouble
    assert np.isfinite(run_job(Job(coarse_episode(0), BASE), library()).points).all()
