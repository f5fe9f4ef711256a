"""From evidence to a verdict without an engine: what is planted is named, with its interval; nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.amplitude import RESPONSE_ERROR
from plop.diagnosis.amplitudes import _moved
from plop.diagnosis.conclusion import conclusion
from plop.diagnosis.finding import CARRIED
from plop.diagnosis.next_motion import next_motion
from plop.diagnosis.next_step import next_step
from plop.diagnosis.verdict import Verdict
from plop.errors import PlopError
from plop.physics.effects.library import library
from stages.diagnose.outcome import facts_of, rows_of
from tests.support.synthetic_evidence import CANDIDATES, NOISE_M, FakeTable, candidate, episodes, key, state

SHAMS = 99


def conclude(measured, reference=None, candidates=CANDIDATES, sensors=()):
    return conclusion(state(measured, reference, candidates), sensors, SHAMS, 0)


def finding(found, name):
    return next(f for f in found.findings if f.name == name)


def test_a_planted_law_is_named_with_an_interval_that_holds_it():
    found = conclude(episodes(1, {"tilt": 0.3}), episodes(2))
    assert (found.verdict.kind, found.verdict.named) == ("EFFECT", ["tilt"])
    value = finding(found, "tilt").parameters["a"]
    assert value["value"] == pytest.approx(0.3, abs=0.03)
    assert value["low"] < 0.3 < value["high"] and value["high"] - value["low"] < 4.2 * RESPONSE_ERROR * 0.3
    assert found.size.error > 1.5 * found.size.floor and found.size.excess > 3
    assert found.size.floor == pytest.approx(1, abs=0.3)


def test_nothing_planted_nothing_named():
    found = conclude(episodes(3), episodes(4))
    assert (found.verdict.kind, found.verdict.named) == ("NOTHING DETECTABLE", [])
    assert found.limits["tilt"]["amplitude"] > 0


def test_a_stiffer_base_is_a_base_parameter():
    found = conclude(episodes(5, {"stiffness": 0.5}), episodes(6))
    assert (found.verdict.kind, found.verdict.named) == ("BASE PARAMETER", ["stiffness"])
    assert found.findings[-1].parameters["a"]["value"] == pytest.approx(0.5, abs=0.05)


def test_a_decoy_leaves_none_of_these():
    assert conclude(episodes(7, {"drag": 0.4}), episodes(8)).verdict.kind == "NONE OF THESE"


def test_a_law_that_nobody_knows_is_none_of_these():
    """Residuals of a law outside the library, with another field in every episode."""
    strange = [
        replace(e, residual=e.residual + 2e-3 * np.sin(40 * k + np.arange(e.residual.size)).reshape(e.residual.shape))
        for k, e in enumerate(episodes(9))
    ]
    assert conclude(strange, episodes(10)).verdict.kind == "NONE OF THESE"


def test_the_same_in_the_reference_is_not_missing():
    """What the base misses everywhere is a known misfit, not an effect of these recordings."""
    found = conclude(episodes(11, {"tilt": 0.3}), episodes(12, {"tilt": 0.3}))
    assert found.verdict.kind == "NOTHING DETECTABLE"
    contrast = finding(found, "tilt").contrast
    assert contrast is not None and contrast.p > 0.1


def test_an_amplitude_outside_its_range_is_named_as_a_part_at_most():
    narrow = [candidate(c.effect, low=0.0, high=0.1) if c.effect == "tilt" else c for c in CANDIDATES]
    found = conclude(episodes(13, {"tilt": 0.3}), episodes(14), narrow)
    value = finding(found, "tilt").parameters["a"]
    assert value["at_bound"] and value["value"] == 0.1
    assert (found.verdict.kind, found.verdict.named) == ("PARTLY", ["tilt"])
    wide = conclude(episodes(13, {"tilt": 0.3}), episodes(14), CANDIDATES)
    assert 0.1 < finding(found, "tilt").gain < 0.8 * finding(wide, "tilt").gain, "no more of it than its range allows"
    below = [candidate(c.effect, low=0.0) if c.effect == "tilt" else c for c in CANDIDATES]
    found = conclude(episodes(13, {"tilt": -0.3}), episodes(14), below)
    assert finding(found, "tilt").parameters["a"]["at_bound"] and "tilt" not in found.verdict.named
    assert finding(found, "tilt").gain <= 0


def test_a_law_that_would_need_more_than_its_range_does_not_stand_before_one_that_fits():
    tilt, fibres = key("tilt"), key("fibres")
    alike = [
        replace(e, responses={**e.responses, fibres: e.responses[tilt] + e.responses[fibres] / 2})
        for e in episodes(13, {"tilt": 0.3})
    ]
    narrow = [candidate(c.effect, low=0.0, high=0.02) if c.effect == "tilt" else c for c in CANDIDATES]
    found = conclude(alike, episodes(14), narrow)
    assert found.findings[0].name == "fibres" and found.findings[0].gain > finding(found, "tilt").gain


def test_confounded_laws_come_with_the_motion_that_tells_them_apart():
    data = [
        replace(
            e, responses={**e.responses, key("fibres"): 0.02 * e.responses[key("fibres")] + e.responses[key("tilt")]}
        )
        for e in episodes(15, {"tilt": 0.3})
    ]
    other = [replace(e, responses={**e.responses, key("fibres"): e.responses[key("tilt")]}) for e in episodes(16)]
    found = conclude(data, other)
    assert found.verdict.kind == "CONFOUNDED" and set(found.verdict.named) == {"tilt", "fibres"}
    following = next_motion(found)
    assert following is not None and next_step(found) == following["text"]
    partly = replace(found, verdict=replace(found.verdict, kind="PARTLY"))
    assert next_step(partly) == following["text"], "what cannot be told apart is not added"
    apart = {}
    for e in found.evidence:  # what is left of one response when the other's multiple is taken off
        sigma = found.misfit.sigma(e)
        a, b = ((e.responses[key(name)] / sigma).ravel() for name in ("tilt", "fibres"))
        apart[e.name] = np.linalg.norm(a - (a @ b) / (b @ b) * b)
    assert following["episode"] == max(apart, key=apart.__getitem__)
    assert following["episode"] in following["text"]


def test_of_a_law_that_one_episode_alone_shows_more_is_asked_for():
    shown = []
    for k, e in enumerate(episodes(17)):
        response = e.responses[key("tilt")] * (1.0 if k == 2 else 0.05)
        shown.append(replace(e, responses={**e.responses, key("tilt"): response}, residual=e.residual + 0.8 * response))
    found = conclude(shown, episodes(18))
    name = shown[2].name
    assert found.verdict.named == [] and finding(found, "tilt").reasons() == [CARRIED]
    following = next_motion(found)
    assert following is not None and following["episode"] == name
    assert "tilt" in following["text"] and f"{name} alone shows it" in found.verdict.text
    assert facts_of(found, library(), [], {})["next_motion"] == following


def test_a_law_that_acts_in_one_episode_only_is_told_with_its_fit():
    """What cuts resist shows in cuts: held out, the one cut is predicted by episodes that hold no word of it."""
    shown = []
    for k, e in enumerate(episodes(17, rough_m=2 * NOISE_M)):
        response = e.responses[key("tilt")] * (2.0 if k == 2 else 0.0)
        shown.append(replace(e, responses={**e.responses, key("tilt"): response}, residual=e.residual + 0.8 * response))
    found = conclude(shown, episodes(18))
    law = finding(found, "tilt")
    assert (found.verdict.kind, found.verdict.named) == ("NONE OF THESE", [])
    assert law.gain < 0.05 and law.shown > 0.4 and law.shown_by == shown[2].name
    assert "fitted to all episodes, tilt takes" in found.verdict.text and "a = 0.826" in found.verdict.text
    following = next_motion(found)
    assert following is not None and following["episode"] == shown[2].name
    several = finding(conclude(episodes(1, {"tilt": 0.3}), episodes(2)), "tilt")
    assert several.shown_by == "" and several.shown == pytest.approx(several.gain, abs=0.05)


@pytest.mark.parametrize(
    ("kind", "named", "says"),
    [
        ("SENSOR", ["cam_0"], "plop calibrate"),
        ("EFFECT", ["tilt"], "plop augment --effect tilt --diagnosis"),
        ("EFFECT", ["tilt", "fibres"], "more is missing"),
        ("PARTLY", ["fibres"], "diagnose again with"),
        ("BASE PARAMETER", ["stiffness"], "plop identify"),
        ("NONE OF THESE", [], "--effect-file"),
        ("CONFOUNDED", ["tilt", "fibres"], "tell tilt and fibres apart"),
        ("NOTHING DETECTABLE", [], "(0."),
    ],
)
def test_after_every_verdict_it_is_said_what_to_do_next(kind, named, says):
    found = conclude(episodes(3), episodes(4))
    told = next_step(replace(found, verdict=Verdict(kind, named, "", {})))
    assert says in told and told.endswith(".")
    if kind == "NOTHING DETECTABLE":
        easiest = min((f["displacement_m"], name) for name, f in found.limits.items() if name != "drag")[1]
        assert f"{easiest} from" in told and "drag" not in told


def test_one_named_effect_needs_no_next_motion():
    assert next_motion(conclude(episodes(1, {"tilt": 0.3}), episodes(2))) is None


def test_facts_are_plain_json_with_every_key():
    import json

    found = conclude(episodes(1, {"tilt": 0.3}), episodes(2))
    facts = facts_of(found, library(), [], {"e9": "no track"})
    text = json.dumps(facts, allow_nan=False)
    assert set(json.loads(text)) >= {
        "schema",
        "verdict",
        "ranking",
        "base",
        "confounded",
        "limits",
        "sensors",
        "shams",
        "error",
        "floor",
        "excess",
        "closed_share",
        "next_step",
        "next_motion",
        "episodes",
        "dropped",
    }
    assert facts["ranking"][0]["effect"] == "tilt" and facts["ranking"][0]["passes"]
    assert facts["base"]["effect"] == "stiffness" and facts["dropped"] == {"e9": "no track"}
    assert facts["closed_share"] > 0.8
    rows = rows_of(facts)
    assert rows[0]["verdict"] == "named" and rows[-1]["effect"] == "stiffness"
    assert len({tuple(row) for row in rows}) == 1  # one table


def test_what_was_dropped_says_of_which_set():
    now = state(episodes(1), episodes(2))
    now.tables = [FakeTable(now.evidence, {"e7": "too far"}), FakeTable(now.control, {"e7": "unstable"})]
    assert conclusion(now, (), SHAMS, 0).dropped == {"e7": "too far", "reference e7": "unstable"}


def test_an_unstable_column_leaves_its_candidate_out_and_without_any_there_is_no_verdict():
    from plop.diagnosis.findings import State

    tables = [FakeTable(episodes(1), {key("tilt"): "unstable"}), FakeTable(episodes(2))]
    names = {c.effect for c in State(tables, CANDIDATES).screen.candidates}  # type: ignore[arg-type]
    assert "tilt" not in names and "viscosity" in names
    tables[1].dropped = {key(c.effect): "unstable" for c in CANDIDATES}
    with pytest.raises(PlopError, match="no response"):
        State(tables, CANDIDATES)  # type: ignore[arg-type]


def test_without_a_stable_stiffness_the_laws_are_still_judged():
    tables = [FakeTable(episodes(1, {"tilt": 0.3}), {key("stiffness"): "unstable"}), FakeTable(episodes(2))]
    from plop.diagnosis.findings import State

    found = conclusion(State(tables, CANDIDATES), (), SHAMS, 0)  # type: ignore[arg-type]
    assert found.verdict.named == ["tilt"] and found.findings[-1].parameters == {}


def test_an_amplitude_beside_others_may_stay_small_and_one_by_itself_may_not():
    """A law with one amplitude has to be seen; of several it is their sum that is seen."""
    alone = candidate("tilt")
    pair = replace(alone, columns=(alone.columns[0], replace(alone.columns[0], amplitude="b")))
    fitted = {alone.key: np.array([0.01, -0.01])}
    assert [c.value for c in _moved([pair], fitted)[0].columns] == [0.05, -0.05]
    assert _moved([alone], {alone.key: fitted[alone.key][:1]})[0].columns[0].value == 1.0
    assert _moved([alone], {alone.key: np.array([0.3])})[0].columns[0].value == 0.3
