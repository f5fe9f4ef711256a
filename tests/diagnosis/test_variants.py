"""An interval holds what the amplitude is in every setting of a law that does as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.candidates import Column
from plop.diagnosis.conclusion import Diagnosis
from plop.diagnosis.next_motion import next_motion, settling_motion
from plop.diagnosis.next_step import next_step
from plop.diagnosis.responses import Answer, Job
from plop.diagnosis.variants import as_good, others_of
from plop.parameters import short_number
from plop.physics.effects.library import EffectType, library
from tests.support.synthetic_evidence import episodes, state
from tests.support.world import World

LAWS = ("stiffness", "adhesion", "viscosity", "swelling")
SOON, SOME, BETWEEN = 0.03, 0.1, 0.05
STRENGTH = {SOON: 0.25, SOME: 1.0, BETWEEN: 0.4}
"""What a bond does that lets go in this time [s]."""
HIDDEN_PA = 300.0


class Sticky(World):
    """A bond that lets go sooner does less, in the same way (`alike`) or in a way of its own."""

    def __init__(self, alike: bool) -> None:
        super().__init__()
        self.alike = alike

    def amounts(self, values: dict[str, float]) -> list[float]:
        bonds = [STRENGTH[release] * values.get(_bond(release), 0.0) / 100 for release in STRENGTH]
        ways = [sum(bonds)] if self.alike else bonds
        return [
            values.get("stiffness", 0.0),
            values.get("viscosity", 0.0) / 100,
            10 * values.get("swelling", 0.0),
            *ways,
        ]

    def run(self, jobs: list[Job]) -> list[Answer]:
        return [Answer(self.moved(job.episode, {_key(c): value for c, value in job.settings})) for job in jobs]


def _bond(release_s: float) -> str:
    return f"adhesion {release_s:g}"


def _key(column: Column) -> str:
    return _bond(dict(column.shapes)["release_s"]) if column.effect == "adhesion" else column.effect


def tried_with(*releases: float) -> dict[str, EffectType]:
    """The library, in which adhesion is tried with these times."""
    law = library()["adhesion"]
    variants = tuple({"release_s": release} for release in releases)
    return {**library(), "adhesion": type("Tried", (law,), {"variants": variants})}


def told(world: World, release: float, *tried: float) -> Diagnosis:
    found = world.told({_bond(release): HIDDEN_PA}, LAWS, tried_with(*tried))
    assert (found.verdict.kind, found.verdict.named) == ("EFFECT", ["adhesion"])
    return found


def traction(world: World, release: float, *tried: float) -> dict[str, float]:
    return told(world, release, *tried).findings[0].parameters["traction_pa"]


def test_what_cannot_be_told_apart_widens_the_interval():
    fitted = traction(Sticky(alike=True), BETWEEN, SOON, SOME)
    assert fitted["low"] < HIDDEN_PA * STRENGTH[BETWEEN] / STRENGTH[SOME]
    assert fitted["high"] > HIDDEN_PA * STRENGTH[BETWEEN] / STRENGTH[SOON] > HIDDEN_PA


def test_the_verdict_says_which_settings_do_as_well_and_what_motion_would_tell():
    found = told(Sticky(alike=True), BETWEEN, SOON, SOME)
    given = found.findings[0].parameters["release_s"]
    assert {given["value"], *given["also"]} == {SOON, SOME}
    assert f"release_s = {given['value']:g} (or {given['also'][0]:g}) s" in found.verdict.text
    motion = settling_motion(found)
    assert next_motion(found) is None and motion is not None
    assert motion["episode"] in {e.name for e in found.evidence} and motion["episode"] in motion["text"]
    own = short_number(found.findings[0].parameters["traction_pa"]["value"])
    assert f"release_s = {given['value']:g} s with traction_pa = {own} Pa, or " in motion["text"]
    assert list(motion["separation"]) == [f"release_s = {given['also'][0]:g} s"]
    assert next_step(found).startswith("Add it: `plop augment") and next_step(found).endswith(motion["text"])


def test_a_setting_that_is_known_asks_for_no_motion():
    found = told(Sticky(alike=False), SOME, SOON, SOME)
    assert found.findings[0].parameters["release_s"]["also"] == [] and settling_motion(found) is None
    assert next_step(found).endswith("how far the error has fallen.")


def test_with_one_setting_alone_the_truth_is_outside():
    """What the other test would be worth if the interval were wide anyway."""
    assert traction(Sticky(alike=True), BETWEEN, SOME)["high"] < HIDDEN_PA


def test_what_does_worse_does_not_widen_it():
    own, both = traction(Sticky(alike=False), SOME, SOME), traction(Sticky(alike=False), SOME, SOON, SOME)
    for name in ("value", "low", "high"):
        assert both[name] == pytest.approx(own[name], rel=0.05)


def test_only_other_settings_of_the_same_law_are_fitted_beside():
    scores = state(episodes(1, {"tilt": 0.3}), episodes(2)).scores()
    assert others_of([scores[0].candidate.key], scores) == {}
    other = replace(scores[1], candidate=replace(scores[1].candidate, effect=scores[0].candidate.effect))
    found = others_of([scores[0].candidate.key], [scores[0], other, *scores[2:]])
    assert list(found) == [other.candidate.key] and np.array_equal(found[other.candidate.key], other.values)


def test_as_good_is_what_is_no_worse_but_for_chance():
    best = state(episodes(1, {"tilt": 0.3}), episodes(2)).scores()[0]
    column = replace(best.candidate.columns[0], shapes=(("tau_s", 1.0),))
    like = replace(best.candidate, columns=(column,))
    bit = np.array([1.0, -1.0, 2.0, -2.0, 1.0, 0.0])
    assert as_good(best, [best]) == []
    assert len(as_good(best, [replace(best, candidate=like, after=best.after + bit)])) == 1
    assert as_good(best, [replace(best, candidate=like, after=best.after + 5 + bit)]) == []
    law = replace(like, effect="viscosity")
    assert as_good(best, [replace(best, candidate=law, after=best.after)]) == []
