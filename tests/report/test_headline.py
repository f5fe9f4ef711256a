"""The headline: one plain sentence for every kind of verdict."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from plop.diagnosis.decision.limits import Limit
from plop.diagnosis.decision.result import Diagnosis, Ranked
from plop.diagnosis.decision.verdict import VerdictKind
from plop.diagnosis.evidence.description import Description, Shown
from plop.parameters import Estimate
from plop.reporting.headline import headline
from tests.support.diagnoses import clock, diagnosis, ranked, verdict

STICKY = "the tool is sticky. It lets go late!"  # two sentences, as a user's law may have them


def row(effect: str, gain: float = 0.958, p: float = 0.005, kind: str = "physics") -> Ranked:
    name = "d_ln_e" if kind == "base" else "traction_pa"
    told = {"adhesion": STICKY, "viscosity": "the material resists fast deformation"}.get(effect, "")
    return ranked(effect, {name: Estimate(0.3, 0.2, 0.4, "Pa")}, kind=kind, help=told, gain=gain, p=p)


def diagnosed(kind: str, *named: str, sensors: tuple = (), base: float = -2.0, **evidence: Any) -> Diagnosis:
    limits = {
        "adhesion": Limit(80.0, "Pa", "traction_pa", 4e-4),
        "tilt": Limit(None, "m/s^2", "gx_m_s2", None),
        "viscosity": Limit(90.0, "Pa s", "viscosity_pa_s", 1.3e-3),
    }
    return diagnosis(
        verdict(kind, *named, **evidence),
        row("adhesion"),
        row("viscosity", 0.7, 0.015),
        row("tilt", -2.0, 1.0),
        row("drag", 0.1, 0.4, "decoy"),
        row("stiffness", base, 0.005, "base"),
        limits=limits,
        sensors=sensors,
        error=40.0,
        floor=1.3,
    )


PLACE = Shown("push hold", 1.4, 0.6)
PUSHED = Description((PLACE,), (PLACE,), PLACE, PLACE, PLACE, PLACE, 0.1, None, 0.2)
CASES = [
    (
        diagnosed("EFFECT", "adhesion"),
        "is missing is adhesion (the tool is sticky): it explains 96 % of the error, and "
        "by chance alone this would happen about once in 200 trials",
    ),
    (diagnosed("EFFECT", "adhesion", share=0.4), "it explains 40 % of the error"),
    (
        diagnosed("EFFECT", "adhesion", "viscosity", share=0.99),
        "together they explain 99 % of the error, and by chance alone this would happen about once in 67 trials",
    ),
    (diagnosed("PARTLY", "adhesion"), "part of what is wrong with base is adhesion"),
    (diagnosed("PARTLY", "adhesion", "viscosity", alternatives=("viscosity",)), "cannot distinguish"),
    (
        diagnosed("EFFECT", "adhesion", closed=0.97),
        "it explains 97 % of the difference to the recordings where nothing",
    ),
    (diagnosed("PARTLY", "stiffness", base=0.4), "is its stiffness: it explains 40 % of the error"),
    (
        diagnosed("BASE PARAMETER", "stiffness", base=0.6, rest_p=0.4),
        "no law is missing from base, but its stiffness "
        "is off (it should be 1.35 times as large): changing it explains 60 % of the error",
    ),
    (diagnosed("BASE PARAMETER", "stiffness", base=0.6, rest_p=0.001), "though what is left still differs"),
    (
        diagnosed("BASE PARAMETER", "stiffness", base=0.6, alternatives=("density",)),
        "its stiffness or density, which these motions cannot distinguish, is off",
    ),
    (
        diagnosed("CONFOUNDED", "adhesion", "viscosity", alternatives=("viscosity",)),
        "either adhesion (the tool is "
        "sticky) or viscosity (the material resists fast deformation) is missing from base, but these motions cannot",
    ),
    (diagnosed("CONFOUNDED", "stiffness", "viscosity", base=0.5, share=0.5), "either the stiffness of base is off or"),
    (
        diagnosed("NONE OF THESE", change_p=0.001),
        "none of the 3 laws that were tried explains: the recordings differ from those where nothing is missing, and "
        "by chance alone this would happen about once in 1,000 trials",
    ),
    (
        diagnosed("NONE OF THESE", change_p=0.2, resembles="adhesion"),
        "that none of the 3 laws that were tried explains: it resembles adhesion, and by chance alone this would "
        "happen about once in 200 trials, but what that leaves still stands out",
    ),
    (replace(diagnosed("NONE OF THESE", decoys=("drag",)), floor=None), "best is drag"),
    (
        diagnosed("NOTHING DETECTABLE", change_p=0.08, description=PUSHED),
        "but they may differ from those where nothing is missing (by chance alone this would happen about once in 12 "
        "trials): record more motions like push hold, here and in the reference",
    ),
    (diagnosed("NOTHING DETECTABLE"), "found about nine times in ten, except for 1 of 3"),
    (diagnosed("NOTHING DETECTABLE", alone=("cam_0",)), "base is off far more in cam_0 than in all others"),
    (diagnosed("NOTHING DETECTABLE", reference=False), "cannot be named without reference recordings"),
    (replace(diagnosed("NOTHING DETECTABLE"), limits={}), "could not have shown any"),
    (
        diagnosed("SENSOR", "x", sensors=(clock(),)),
        "camera cam_02 is faulty (the camera's clock is late or early, 0.04 s)",
    ),
    (diagnosed("SENSOR", "x", sensors=(clock(), clock("cam_03", "own_fault"))), "cam_03 is faulty (own fault"),
]


@pytest.mark.parametrize(("found", "words"), CASES)
def test_it_is_one_plain_sentence_that_says_what_is_found(found, words):
    said = headline("base", found)
    assert words in said[0].lower() + said[1:] and said[0].isupper()
    assert len(re.findall(r"[.!?](?=\s|$)", said)) == 1 and said.endswith(".")
    plain = said.replace("cam_0", "")  # names of the user's own
    assert not re.search(r"p [=<]|±|_|residual|whitened|sham", plain), said
    assert not re.search(r"-\d", said), "no share is negative"


def test_every_kind_of_verdict_has_its_headline():
    for kind in VerdictKind:
        assert headline("base", diagnosed(kind, "adhesion"))
