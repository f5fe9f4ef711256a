"""Plans in a world without engine: what is said to be seen is seen, and the planned motion distinguishes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.responses.table import Measured
from plop.errors import PlopError
from plop.parameters import Estimate
from plop.physics.effects.library import library
from plop.planning.design import DRAWS, Design
from plop.planning.motions import Change
from plop.planning.plan import Planned, Wish, plan
from plop.planning.protocol import plan_of
from plop.planning.separation import Pair, information, settled_chance
from stages.diagnose.outcome import diagnosis_of
from tests.support.coarse_episodes import BASE, coarse_episode
from tests.support.diagnoses import diagnosis, ranked, verdict
from tests.support.world import NOISE_M, World

LAWS = ("swelling", "viscosity", "softening")


class Lasting(World):
    """Swelling and viscosity do the same in every motion that lasts as long as the recorded ones, else not."""

    def amounts(self, values):
        swelling, viscosity = 10 * values.get("swelling", 0.0), values.get("viscosity", 0.0) / 100
        return [swelling + viscosity, 0.0 * viscosity, values.get("softening", 0.0) * 0.0, values.get("stiffness", 0.0)]

    def motion(self, name):
        """Every motion is in both sets."""
        return int(name[-1])

    def fields(self, episode, number):
        """As in `World`, for the number of the recorded motion, which a planned one has in its name."""
        own = re.search(r"\d{3}", episode.name)
        return super().fields(replace(episode, name=own.group()), number)

    def moved(self, episode, values):
        total = super().moved(episode, values)
        longer = max(0.0, float(np.ptp(episode.times)) / self.usual(episode) - 1.2)
        return total + 3 * longer * values.get("viscosity", 0.0) / 100 * self.fields(episode, 7)

    def usual(self, episode):
        return {0: self.lengths[0], 1: self.lengths[1]}[int(re.search(r"\d{3}", episode.name).group()) % 2]

    def __init__(self):
        super().__init__()
        self.lengths = [float(np.ptp(coarse_episode(k).times)) for k in range(2)]

    def again(self, like, motion, count, hidden, seed):
        """Record a planned motion: the law acts, and there is noise."""
        episodes = []
        for k in range(count):
            frames = len(motion.tool.times)
            still = replace(
                like,
                name=f"{motion.like} {k}",
                times=motion.tool.times,
                tool=motion.tool,
                points=np.repeat(like.points[:1], frames, 0),
                seen=None,
            )
            noise = np.random.default_rng([seed, k]).normal(0, NOISE_M, still.points.shape)
            points = self.moved(still, hidden) + noise
            points[0] = like.points[0]
            episodes.append(replace(still, points=points))
        return episodes


def planned(world: World, wish: Wish = Wish(), count: int = 6, laws=LAWS) -> Planned:
    reference = Measured(world.measured(2, {}).episodes[:count])
    return plan(reference, BASE, library(), world.run, wish, effects=laws)


def power(found: Planned, law: str):
    return next(each for each in found.laws if each.effect == law)


def test_draws_have_the_covariance_of_the_evidence_though_responses_resemble_each_other(monkeypatch):
    monkeypatch.setattr("plop.planning.design.DRAWS", 40_000)
    root = np.random.default_rng(3).normal(size=(6, 4))
    design = object.__new__(Design)
    design.gram, design._seed = (root @ root.T).reshape(2, 3, 2, 3), 0
    drawn = design.draws.reshape(-1, 6)
    np.testing.assert_allclose(np.cov(drawn.T), root @ root.T, atol=0.03 * np.trace(root @ root.T) / 6)
    assert np.linalg.matrix_rank(drawn) == 4


def test_an_amplitude_that_is_said_to_be_seen_is_named_and_a_small_part_of_it_is_not():
    world = Lasting()
    limit = abs(power(planned(world, Wish(most=1)), "stiffness").amplitude)
    assert 0 < limit < 0.7
    found = [
        diagnose(
            world.measured(20 + k, {"stiffness": share * limit}),
            BASE,
            library(),
            world.run,
            reference=world.measured(60 + k, {}),
            effects=LAWS,
        ).verdict.named
        for share in (1.5, 0.05)
        for k in range(3)
    ]
    assert ["stiffness" in named for named in found] == [True] * 3 + [False] * 3, found


def test_few_motions_show_more_when_repeated():
    found = planned(Lasting(), Wish(most=2), count=4)
    law = power(found, "stiffness")
    assert found.ways[0] < 100 <= found.ways[1]
    assert law.chances[0] <= law.chances[1] and law.chances[1] > 0.9


def test_a_law_without_response_is_left_out_and_cannot_be_distinguished():
    found = planned(Lasting(), Wish(most=1))
    assert "softening" in found.dropped and "softening" not in {law.effect for law in found.laws}
    with pytest.raises(PlopError, match="does nothing in these motions") as caught:
        planned(Lasting(), Wish(between=("softening", "swelling"), most=1))
    assert "softening" in str(caught.value.where)


def carried_out(world: World, fewer: int = 0, law: str = "viscosity"):
    """Plan for a confounded verdict, record the planned motion, and diagnose again: the plan, and the new verdict."""
    hidden = {law: {"viscosity": 200.0, "swelling": 0.2}[law]}
    here, reference = world.measured(1, hidden), world.measured(2, {})
    first = diagnose(here, BASE, library(), world.run, reference=reference, effects=LAWS)
    assert first.verdict.kind == "CONFOUNDED" and {*first.verdict.named} == {"swelling", "viscosity"}
    kept = diagnosis_of(first, library(), (), {}, environment="box")
    found = plan(reference, BASE, library(), world.run, Wish(diagnosis=kept))
    separation, best = found.separation, found.best
    assert separation is not None and best is not None
    assert best.change in (Change.SLOWER, Change.RESTING) and separation.settled >= 0.9 > separation.chance
    assert {c.change for c in separation.choices[:2]} <= {Change.SLOWER, Change.RESTING}
    like = next(e for e in reference.episodes if e.name == best.like)
    count = separation.repeats - fewer
    more, plain = world.again(like, best, count, hidden, 5), world.again(like, best, count, {}, 6)
    after = diagnose(
        Measured([*here.episodes, *more]),
        BASE,
        library(),
        world.run,
        reference=Measured([*reference.episodes, *plain]),
        effects=LAWS,
    )
    return found, after.verdict


class Unlike(Lasting):
    """No motion is in both sets."""

    motion = World.motion


@pytest.mark.parametrize("law", ["viscosity", "swelling"])
def test_the_planned_motion_settles_it_where_no_motion_was_repeated(law):
    found, verdict = carried_out(Unlike(), law=law)
    assert (verdict.kind, verdict.named) == ("EFFECT", (law,)), verdict
    assert found.separation.repeats == 1


def test_a_recording_with_the_name_of_one_of_the_reference_is_no_repeat_of_it():
    world = Unlike()
    reference = world.measured(2, {})
    here = world.measured(1, {"viscosity": 200.0})
    first = diagnose(here, BASE, library(), world.run, reference=reference, effects=LAWS)
    kept = diagnosis_of(first, library(), (), {}, environment="box")
    assert not kept.repeats
    other, same = (
        plan(reference, BASE, library(), world.run, Wish(diagnosis=replace(kept, episodes=names))).separation
        for names in (kept.episodes, kept.reference_episodes)
    )
    assert same == other and same.repeats == 1


def test_recorded_once_less_than_planned_the_laws_stay_confounded():
    assert carried_out(Lasting(), fewer=1)[1].kind == "CONFOUNDED"


def test_the_planned_motion_settles_what_was_confounded():
    found, verdict = carried_out(Lasting())
    assert (verdict.kind, verdict.named) == ("EFFECT", ("viscosity",)), verdict
    separation = found.separation
    kept_plan = plan_of(found, diagnosed=True, again=True, environment="box")
    (step,) = kept_plan.steps
    assert step.repeats == step.reference == separation.repeats and step.file.startswith("motions/")
    assert kept_plan.rounds == ((step.motion,),) * separation.repeats


def test_between_takes_laws_at_typical_amplitudes_and_records_all_motions():
    found = planned(Lasting(), Wish(between=("swelling", "viscosity"), most=1))
    kept = plan_of(found, diagnosed=False, again=False, environment="box")
    assert kept.separation.laws == ("swelling", "viscosity")
    assert len(kept.steps) == 6 + (found.best.change != Change.NONE)
    assert all(step.reference == 0 for step in kept.steps)
    assert "swelling from viscosity" in kept.text


def test_a_diagnosis_with_one_answer_leaves_nothing_to_distinguish():
    clear = diagnosis(verdict("EFFECT", "tilt"), ranked("tilt", {"gx_m_s2": Estimate(1.0, 0.9, 1.1)}))
    with pytest.raises(PlopError, match="nothing to distinguish"):
        planned(Lasting(), Wish(diagnosis=clear))


def test_settings_that_fit_equally_well_are_distinguished():
    world = Lasting()
    parameters = {
        "ratio": Estimate(0.8, 0.7, 0.9),
        "tau_s": Estimate(0.05, alternatives=(0.2,), fitted=False, unit="s"),
    }
    said, again = ranked("relaxation", parameters), {"episodes": ("box_020",) * 6, "repeats": {"box_020": "box_020"}}
    open_ = diagnosis(verdict("EFFECT", "relaxation"), said, **again)

    def amounts(values):
        return [values.get("relaxation", 0.0)]

    world.amounts = amounts
    found = planned(world, Wish(diagnosis=open_))
    assert found.separation.laws == ("tau_s = 0.05 s", "tau_s = 0.2 s")
    assert found.separation.settled < 0.9  # in this world both settings do the same in every motion
    text = plan_of(found, diagnosed=True, again=True, environment="box").text
    assert "may well stay confounded" in text


def test_draws_have_the_covariance_of_the_products_and_information_is_the_least_squares_minimum():
    found = planned(Lasting(), Wish(most=1))
    design = Design(found.motions, found.motions)
    flat = design.draws.reshape(DRAWS, -1)
    expected = np.diag(design.gram.reshape(flat.shape[1], flat.shape[1]))
    assert (flat**2).mean() == pytest.approx(expected.mean(), rel=0.3)
    # columns of the most similar responses, against a search over both amounts
    pair, z = Pair(0, len(found.motions[0].responses) - 1), design.here.astype(float)
    a, b, c = (design.gram[:, i, :, j] for i, j in ((0, 0), (pair.rival, 0), (pair.rival,) * 2))
    scale = float(z @ a @ z)

    def left(x):
        amounts = x[0] * z + x[1]
        return float(z @ a @ z - 2 * amounts @ b @ z + amounts @ c @ amounts) / scale

    best = minimize(left, [0.5, 0.5], bounds=[(0, None), (None, None)]).fun
    alone = minimize(lambda s: float((z - s) @ a @ (z - s)) / scale, [0.0]).fun
    assert information(design, pair) == pytest.approx(0.5 * scale * (best - 0.0625 * alone), abs=1e-3 * scale)


def test_what_was_found_in_recordings_stays_and_is_not_drawn():
    """The motions do not distinguish the pair: only what was found does."""
    found = planned(Lasting(), Wish(most=1))
    design, pair = Design(found.motions, found.motions), Pair(0, 1)
    strong, weak = np.full(design.here.sum(), 1e6), np.ones(design.here.sum())

    def chance(truth, rival):
        return settled_chance(lambda k: design, [pair], {pair.truth: truth, pair.rival: rival})

    assert chance(strong, weak) > 0.9
    assert chance(strong, strong) == chance(weak, strong) == settled_chance(lambda k: design, [pair]) == 0
