"""From evidence to a verdict in a world without engine: what is hidden is named, with its interval; nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.decision import conclusion
from plop.diagnosis.decision.conclusion import conclude
from plop.diagnosis.decision.next_step import next_step
from plop.diagnosis.decision.result import Diagnosis, SensorFault
from plop.diagnosis.decision.verdict import Reason, VerdictKind
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.responses.table import Measured
from plop.diagnosis.rule import RULE
from plop.diagnosis.scores.calibration import LEAST
from plop.diagnosis.scores.search import Search
from plop.errors import PlopError
from plop.parameters import Estimate
from plop.physics.effects.library import library
from stages.diagnose.outcome import diagnosis_of, rows_of
from tests.support.coarse_episodes import BASE
from tests.support.world import World

LAWS = ("swelling", "tilt", "viscosity", "drag", "adhesion")


class Fields(World):
    """Every law is a field of its own; adhesion at 500 Pa does what nothing else does, and needs 200 Pa to begin."""

    def amounts(self, values: dict[str, float]) -> list[float]:
        return [
            20 * values.get("swelling", 0.0),
            values.get("gx_m_s2", 0.0) + 0.5 * values.get("gy_m_s2", 0.0),
            values.get("viscosity", 0.0) / 50,
            values.get("drag", 0.0) / 100,
            max(values.get("adhesion", 0.0) - 200, 0.0) / 200,
            values.get("stiffness", 0.0),
            values.get("outside", 0.0),
        ]


def finding(found, name):
    return next(f for f in found.findings if f.name == name)


def test_a_hidden_law_is_named_with_an_interval_that_holds_it():
    found = Fields().diagnosed({"swelling": 0.06}, LAWS)
    assert (found.verdict.kind, found.verdict.named) == ("EFFECT", ("swelling",)), found.verdict
    value = finding(found, "swelling").parameters["rate_per_s"]
    assert value.value == pytest.approx(0.06, rel=0.05) and value.low < 0.06 < value.high and value.bounded
    facts = found.verdict.evidence
    assert facts.change_p <= 0.01 and facts.closed > 0.9 and facts.rest_p > 0.01
    assert finding(found, "swelling").score.p == LEAST


def test_nothing_hidden_nothing_named_in_many_worlds():
    """The share of alarms is what was asked for: 1 % for each of two alarms, none in 12 worlds but by bad luck."""
    alarms = []
    for seed in range(12):
        world = Fields()
        found = diagnose(
            world.measured(10 + seed, {}),
            BASE,
            library(),
            world.run,
            reference=world.measured(50 + seed, {}),
            effects=LAWS,
        )
        alarms.append(found.verdict.kind)
    assert alarms.count("NOTHING DETECTABLE") >= 11, alarms


def test_what_is_in_the_reference_too_is_not_missing():
    world = Fields()
    for amount in (0.06, -0.06):
        found = diagnose(
            world.measured(1, {"swelling": amount}),
            BASE,
            library(),
            world.run,
            reference=world.measured(2, {"swelling": amount}),
            effects=LAWS,
        )
        assert found.verdict.kind == "NOTHING DETECTABLE", found.verdict


def test_another_stiffness_is_a_base_parameter():
    found = Fields().diagnosed({"stiffness": 0.8}, LAWS)
    assert found.verdict.kind == "BASE PARAMETER" and found.verdict.named[0] == "stiffness", found.verdict
    assert "x 2" in found.verdict.text


def test_a_law_outside_the_library_is_none_of_these():
    found = Fields().diagnosed({"outside": 1.0}, LAWS)
    assert (found.verdict.kind, found.verdict.named) == ("NONE OF THESE", ()), found.verdict
    assert found.verdict.evidence.change_p <= 0.01 and "--effect-file" in next_step(found)


def test_a_law_that_is_certain_but_explains_too_little_is_a_sign_of_another(monkeypatch):
    """The recordings need not differ by themselves: a law that is found is an alarm, too."""
    search = Fields().diagnosed({"swelling": 0.06}, LAWS).search
    grounds = conclusion._grounds(search, ())
    monkeypatch.setattr(conclusion, "_grounds", lambda *_: replace(grounds, change_p=0.2))
    monkeypatch.setattr(conclusion, "stands_out", lambda *_: True)
    monkeypatch.setattr(conclusion, "closed_by", lambda *_: 0.1)
    verdict = conclude(search).verdict
    assert (verdict.kind, verdict.named) == ("NONE OF THESE", ()) and verdict.evidence.description is not None
    assert (
        verdict.evidence.resembles == "swelling"
        and "it resembles swelling" in verdict.text
        and "differ from the reference" not in verdict.text
    )


def test_a_law_that_leaves_more_than_a_wrong_response_would_is_a_part():
    found = Fields().diagnosed({"swelling": 0.06, "outside": 0.4}, LAWS)
    assert (found.verdict.kind, found.verdict.named) == ("PARTLY", ("swelling",)), found.verdict
    facts = found.verdict.evidence
    assert 0.8 < facts.closed < 0.9 and facts.rest_p <= 0.01 and "what is left still stands out" in found.verdict.text


def test_a_decoy_is_none_of_these():
    found = Fields().diagnosed({"drag": 150.0}, LAWS)
    assert found.verdict.kind == "NONE OF THESE" and found.verdict.evidence.decoys == ("drag",)


def test_two_hidden_laws_are_both_named():
    found = Fields().diagnosed({"swelling": 0.08, "viscosity": 60.0}, LAWS)
    assert {*found.verdict.named} == {"swelling", "viscosity"}, found.verdict
    for name, key, value in (("swelling", "rate_per_s", 0.08), ("viscosity", "viscosity_pa_s", 60.0)):
        assert finding(found, name).parameters[key].value == pytest.approx(value, rel=0.15)


def test_of_a_pull_that_shows_in_one_direction_only_that_much_is_found():
    found = Fields().diagnosed({"gx_m_s2": 0.8, "gy_m_s2": 0.5}, LAWS)
    assert found.verdict.named == ("tilt",)
    pull = finding(found, "tilt").parameters
    assert pull["gx_m_s2"].value + 0.5 * pull["gy_m_s2"].value == pytest.approx(0.8 + 0.5 * 0.5, rel=0.1)


class Sideways(Fields):
    """Pulls along x and along y do different things."""

    def amounts(self, values: dict[str, float]) -> list[float]:
        found = super().amounts({**values, "gy_m_s2": 0.0})
        found[5] += values.get("gy_m_s2", 0.0)
        return found


def test_the_direction_of_a_pull_is_found_between_those_that_were_tried():
    found = Sideways().diagnosed({"gx_m_s2": 0.8, "gy_m_s2": 0.5}, LAWS)
    assert found.verdict.named == ("tilt",)
    pull = finding(found, "tilt").parameters
    for name, there in (("gx_m_s2", 0.8), ("gy_m_s2", 0.5)):
        assert pull[name].value == pytest.approx(there, rel=0.1)
        assert pull[name].low < there < pull[name].high


def test_a_law_with_a_threshold_is_followed_to_the_amplitude_that_was_there():
    """At its typical 300 Pa it does a sixth of what it does at 800, so that in proportion it would be 1,800."""
    found = Fields().diagnosed({"adhesion": 800.0}, LAWS)
    assert found.verdict.named == ("adhesion",)
    assert finding(found, "adhesion").parameters["traction_pa"].value == pytest.approx(800, rel=0.1)


class Holding(Fields):
    """A bond that holds from 500 Pa on holds no more whatever its strength."""

    def amounts(self, values: dict[str, float]) -> list[float]:
        found = super().amounts(values)
        found[4] = min(max(values.get("adhesion", 0.0) - 200, 0.0) / 200, 1.5)
        return found


def test_the_interval_of_a_law_that_saturates_goes_on_where_its_response_does_not_change():
    found = Holding().diagnosed({"adhesion": 3000.0}, LAWS)
    assert found.verdict.named == ("adhesion",)
    value = finding(found, "adhesion").parameters["traction_pa"]
    assert value.value < 1500 and value.low < 500 and value.high > 3000, value


class Turning(Fields):
    """Swelling does one thing up to its typical rate of 0.1 per second, and something else with what is beyond."""

    def amounts(self, values: dict[str, float]) -> list[float]:
        found, rate = super().amounts(values), values.get("swelling", 0.0)
        found[0] = 20 * min(rate, 0.1)
        found[6] += 6 * max(rate - 0.1, 0)
        return found


def test_a_law_that_repeats_itself_at_one_amplitude_is_followed_to_where_it_explains_more():
    """At 0.1 its response is found once, exactly; only at more does it explain the rest."""
    found = Turning().diagnosed({"swelling": 0.3}, LAWS)
    assert found.verdict.named == ("swelling",)
    assert finding(found, "swelling").parameters["rate_per_s"].value == pytest.approx(0.3, rel=0.1)


class Alike(Fields):
    """Viscosity does what swelling does, but for a little."""

    def amounts(self, values):
        found = super().amounts(values)
        both = found[0] + 1.0 * found[2]
        return [both, found[1], 0.02 * found[2], *found[3:]]


def test_laws_that_do_the_same_are_confounded_and_a_plan_is_advised():
    found = Alike().diagnosed({"swelling": 0.06}, ["swelling", "viscosity"])
    assert found.verdict.kind == "CONFOUNDED" and {*found.verdict.named} == {"swelling", "viscosity"}, found.verdict
    assert "plop plan --diagnosis" in next_step(found) and "viscosity" in next_step(found)


def test_laws_that_are_one_in_every_motion_want_another_measurement_not_another_motion():
    class Same(Alike):
        def amounts(self, values):
            found = super().amounts(values)
            return [*found[:2], 0.0, *found[3:]]

    found = Same().diagnosed({"swelling": 0.06}, ["swelling", "viscosity"])
    assert found.verdict.kind == "CONFOUNDED" and {*found.verdict.named} == {"swelling", "viscosity"}, found.verdict
    assert "do the same in every motion" in next_step(found) and "plop plan" not in next_step(found)


def test_a_law_that_does_as_well_is_an_alternative_though_its_own_chance_is_not_as_small(monkeypatch):
    """Once a law is certain, something is there, and what else it may be needs the chance for that only."""
    search, own = Alike().diagnosed({"swelling": 0.06}, ["swelling", "viscosity"]).search, Search.chance_of
    for p, kind in ((0.03, "CONFOUNDED"), (0.2, "EFFECT")):
        monkeypatch.setattr(Search, "chance_of", lambda self, law, p=p: p if law == "viscosity" else own(self, law))
        assert conclude(search).verdict.kind == kind


class Rough(Fields):
    """The base misses about 1 mm everywhere, another in each place and the same whenever a motion is repeated."""

    def motion(self, name):
        return int(name[-1]) % 2

    def measured(self, seed, hidden):
        episodes = []
        for k, episode in enumerate(super().measured(seed, hidden).episodes):
            draw = np.random.default_rng([3, k % 2])
            places = (episode.points[0] - episode.points[0].mean(0)) / 0.02
            waves = np.sin(places @ draw.normal(0, 4, (3, 40)) + draw.uniform(0, 2 * np.pi, 40))
            missed = 1e-3 * waves @ draw.normal(0, 20**-0.5, (40, 3))
            ramp = np.linspace(0, 1, len(episode.times))[:, None, None]
            episodes.append(replace(episode, points=episode.points + ramp * missed))
        return Measured(episodes)


def test_what_the_base_misses_in_every_repeat_hides_no_law():
    """The law moves the points by 0.02 mm; an error of 1 mm that is not the same in a repeat hides it."""
    found = Rough().diagnosed({"swelling": 0.0007}, LAWS)
    assert (found.verdict.kind, found.verdict.named) == ("EFFECT", ("swelling",)), found.verdict
    assert finding(found, "swelling").parameters["rate_per_s"].value == pytest.approx(0.0007, rel=0.3)
    assert [len(group) for group in found.search.field.groups] == [6, 6]
    assert Rough().diagnosed({}, LAWS).verdict.kind == "NOTHING DETECTABLE"


class Once(Fields):
    """Swelling acts in one episode only."""

    def amounts_in(self, episode, values):
        return self.amounts(
            values if episode.name.endswith("12") else {k: v for k, v in values.items() if k != "swelling"}
        )

    def moved(self, episode, values):
        total = self.plain(episode)
        for number, amount in enumerate(self.amounts_in(episode, values)):
            total = total + amount * self.fields(episode, number)
        return total


def test_a_law_that_only_one_episode_shows_is_not_named():
    found = Once().diagnosed({"swelling": 0.2}, LAWS)
    assert "swelling" not in found.verdict.named
    assert {Reason.NO_HELP, Reason.ONE_EPISODE, Reason.CHANCE} & {*finding(found, "swelling").reasons}
    (odd,) = found.verdict.evidence.alone
    assert odd in found.verdict.text and odd in next_step(found)


def test_an_amplitude_beyond_its_range_is_named_as_a_part():
    types = dict(library())
    found = Fields().diagnosed({"viscosity": 3000.0}, LAWS, types)
    assert found.verdict.kind == "PARTLY" and found.verdict.named == ("viscosity",), found.verdict
    value = finding(found, "viscosity").parameters["viscosity_pa_s"]
    assert value.at_bound and value.value == 1000.0 and "the end of its range" in found.verdict.text


def test_a_part_that_broke_loose_does_not_decide():
    """In three of six episodes a patch slides 30 mm away, as no law would have it."""
    world = Fields()
    measured = world.measured(1, {"swelling": 0.06})
    episodes = []
    for k, episode in enumerate(measured.episodes):
        points = episode.points.copy()
        if k % 2:
            loose = episode.patch < 3
            points[len(points) // 2 :, loose] += np.array([0.03, 0.01 * k, 0.0])
        episodes.append(replace(episode, points=points))
    found = diagnose(Measured(episodes), BASE, library(), world.run, reference=world.measured(2, {}), effects=LAWS)
    assert found.verdict.named == ("swelling",), found.verdict
    assert finding(found, "swelling").parameters["rate_per_s"].value == pytest.approx(0.06, rel=0.15)


def test_a_sensor_fault_comes_before_physics():
    world = Fields()
    found = diagnose(
        world.measured(1, {"swelling": 0.06}),
        BASE,
        library(),
        world.run,
        reference=world.measured(2, {}),
        effects=LAWS,
        sensors=["clock of cam_02: 40 ms"],
    )
    assert (found.verdict.kind, found.verdict.named) == ("SENSOR", ("clock of cam_02: 40 ms",))
    late = SensorFault("cam_02", "clock", "clock of cam_02: 40 ms", 9.0, {"offset_s": Estimate(0.04)}, ())
    assert "clock of cam_02" in found.verdict.text and "--exclude cam_02" in next_step(found, [late])


def test_without_reference_nothing_is_named_and_a_reference_is_asked_for():
    world = Fields()
    found = diagnose(world.measured(1, {"swelling": 0.06}), BASE, library(), world.run, effects=LAWS)
    assert found.verdict.evidence.change_p is None and found.verdict.evidence.floor is None
    assert found.findings[0].name == "swelling"
    assert found.verdict.kind == "NOTHING DETECTABLE" and "--reference" in next_step(found)


def test_four_and_four_episodes_name_what_is_strong_and_three_are_refused():
    world = Fields()
    few = [Measured(m.episodes[:4]) for m in (world.measured(1, {"swelling": 0.06}), world.measured(2, {}))]
    found = diagnose(few[0], BASE, library(), world.run, reference=few[1], effects=LAWS)
    assert found.verdict.named[:1] == ("swelling",)
    with pytest.raises(PlopError, match="too few episodes"):
        diagnose(Measured(few[0].episodes[:3]), BASE, library(), world.run, effects=LAWS)


def test_limits_are_amplitudes_that_would_have_been_named():
    found = Fields().diagnosed({}, LAWS)
    limit = found.limits["swelling"].amplitude
    assert limit is not None and 0 < abs(limit) < 0.06
    seen = [Fields().diagnosed({"swelling": share * abs(limit)}, LAWS).verdict.named for share in (0.05, 2.0)]
    assert seen == [(), ("swelling",)]


def test_a_law_that_comes_near_to_a_verdict_is_told_with_the_motions_to_record_again():
    found = Fields().diagnosed({"swelling": 0.06}, LAWS)
    nothing = replace(found.verdict, kind=VerdictKind.NOTHING_DETECTABLE)
    near = [replace(f, score=replace(f.score, p=0.03)) for f in found.findings]
    told, gains = next_step(replace(found, verdict=nothing, findings=near)), np.sqrt(near[0].score.recorded)
    assert told.startswith("swelling comes near to a verdict") and "3 % of searches" in told
    names = [evidence.name for evidence in found.search.evidence[:6]]
    assert [name in told for name in names] == list(2 * gains >= gains.max())
    assert next_step(Fields().diagnosed({}, LAWS)).startswith("What would have been named")


def test_a_difference_that_is_not_certain_is_described_with_motions_to_record_again():
    """The alarm that is asked for is one that so few ways of dealing twelve episodes out cannot raise."""
    found = conclude(Fields().diagnosed({"outside": 0.01}, LAWS).search, rule=replace(RULE, alarm=0.002))
    verdict = found.verdict
    assert verdict.kind == VerdictKind.NOTHING_DETECTABLE and verdict.evidence.change_p <= RULE.alike
    assert "They may differ from the reference (p = 0.0" in verdict.text and "On average the object is" in verdict.text
    told = next_step(found)
    assert told.startswith("The recordings may differ") and verdict.evidence.description.motions[0].what in told
    quiet = Fields().diagnosed({}, LAWS).verdict
    assert quiet.evidence.change_p > 2 * RULE.alike and quiet.evidence.description is None


def test_what_is_kept_can_be_read_again():
    found = Fields().diagnosed({"swelling": 0.06}, LAWS)
    kept = diagnosis_of(found, library(), (), {"box_9": "no track"}, environment="box")
    again = Diagnosis.from_json(kept.to_json())
    assert again == kept and again.named[0].effect == "swelling" and again.named[0].passes
    assert again.dropped["box_9"] == "no track" and len(again.episodes) == len(again.reference_episodes) == 6
    assert rows_of(again)[0]["verdict"] == "named"
