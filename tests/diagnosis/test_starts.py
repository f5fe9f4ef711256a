"""Where the search for an amplitude begins: in the direction that is needed, and this side of a threshold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.starts import begun, turned
from plop.physics.effects.library import EffectType, library
from tests.support.synthetic_evidence import CANDIDATES, candidate, episodes, state
from tests.support.world import World

LAWS = ("stiffness", "table_friction", "viscosity", "swelling", "fibres")
LESS = -0.35


class Sliding(World):
    """What holds lets go where little friction is left, and then slides another way than it creeps before."""

    def amounts(self, values: dict[str, float]) -> list[float]:
        d_mu = values.get("table_friction", 0.0)
        creeps, slides = -2 * d_mu if d_mu < 0 else 0.0, 60 * max(-d_mu - 0.4, 0.0)
        return [
            values.get("stiffness", 0.0),
            creeps,
            slides,
            slides,
            values.get("viscosity", 0.0) / 100,
            10 * values.get("swelling", 0.0),
            0.3 * values.get("fibres", 0.0),
        ]


def library_with(tried: tuple[float, ...]) -> dict[str, EffectType]:
    """The library, in which less friction is tried at these amplitudes besides the typical one."""
    law = library()["table_friction"]
    parameter = replace(law.amplitudes[0], tried=tried)
    other = type("Friction", (law,), {"amplitudes": (parameter,)})
    return {**library(), "table_friction": other}


def test_a_law_with_a_threshold_is_found_on_this_side_of_it():
    found = Sliding().told({"table_friction": LESS}, LAWS)
    assert (found.verdict.kind, found.verdict.named) == ("EFFECT", ["table_friction"])
    fitted = found.findings[0].parameters["d_mu"]
    assert fitted["value"] == pytest.approx(LESS, rel=0.1) and fitted["low"] < LESS < fitted["high"]


def test_from_the_far_side_alone_it_is_missed():
    """What the other test would be worth if it were found anyway."""
    found = Sliding().told({"table_friction": LESS}, LAWS, library_with(()))
    assert "table_friction" not in found.verdict.named


def test_nothing_begins_elsewhere_where_nothing_is_hidden():
    found = Sliding().told({}, LAWS)
    assert found.verdict.kind == "NOTHING DETECTABLE"


def test_unstable_amplitudes_are_no_beginning():
    tried = candidate("tilt")
    column = replace(tried.columns[0], tried=(-1.0, 2.0))
    candidates = [replace(tried, columns=(column,)), *(c for c in CANDIDATES if c.effect != "tilt")]
    at = state(episodes(13, {"tilt": -0.3}), episodes(14), candidates)
    energies = {1.0: 3.0, -1.0: 0.5, 2.0: None}
    at.measure = lambda wanted: [None if energies[a] is None else (energies[a] * at.energy, 1.0) for _, a in wanted]
    assert begun(at, candidates)["tilt"].columns[0].value == -1.0
    energies[-1.0] = None
    assert begun(at, candidates) == {}
    energies[1.0] = None
    assert begun(at, candidates) == {}


def test_what_is_left_without_any_law_is_the_residual_without_what_stiffness_can_do():
    at = state(episodes(5, {"stiffness": 0.5}), episodes(6))
    assert at.energy < 0.5 * float(at.screen.grams.energy.sum())
    assert at.energy == pytest.approx(at.numbers, rel=0.3) and np.isfinite(at.energy)


def test_a_law_that_seems_to_act_the_other_way_is_tried_that_way():
    """Less friction moves what more friction does not: the response must be that of the right direction."""
    less, more = state(episodes(13, {"tilt": -0.3}), episodes(14)), state(episodes(1, {"tilt": 0.3}), episodes(2))
    assert turned(less)["tilt"].columns[0].value == -1.0
    assert "tilt" not in turned(more)
    one_sided = [candidate(c.effect, low=0.0) for c in CANDIDATES]
    assert not turned(state(episodes(13, {"tilt": -0.3}), episodes(14), one_sided))
