"""The headline: one plain sentence for every kind of verdict."""

from __future__ import annotations

import re
from typing import Any

import pytest

from plop.reporting.headline import headline

STICKY = "the tool is sticky. It lets go late!"  # two sentences, as a user's law may have them


def row(effect: str, gain: float = 0.958, p: float | None = 0.005, kind: str = "physics", **value: Any) -> dict:
    name = "d_ln_e" if kind == "base" else "traction_pa"
    found = {"value": 0.3, "low": 0.2, "high": 0.4, "unit": "Pa", "at_bound": False, **value}
    told = {"adhesion": STICKY, "viscosity": "the material resists fast deformation"}.get(effect, "")
    return {
        "effect": effect,
        "kind": kind,
        "help": told,
        "gain": gain,
        "gain_error": 0.05,
        "p": p,
        "size_mm": 1.0,
        "parameters": {name: found},
        "reasons": [],
    }


def diagnosis(kind: str, *named: str, sensors: tuple = (), base: float = -2.0, **evidence: Any) -> dict:
    laws = [row("adhesion"), row("viscosity", 0.7, 0.015), row("tilt", -2.0, 1.0), row("drag", 0.1, 0.4, "decoy")]
    limits = {
        "adhesion": {"amplitude": 80.0, "displacement_m": 4e-4},
        "tilt": {"amplitude": None},
        "viscosity": {"amplitude": 90.0, "displacement_m": 1.3e-3},
    }
    return {
        "verdict": {"kind": kind, "named": list(named), "text": "Sentence. Another.", "evidence": evidence},
        "ranking": laws,
        "base": row("stiffness", base, 0.005, "base"),
        "limits": limits,
        "sensors": list(sensors),
        "error": 40.0,
        "floor": 1.3,
    }


CLOCK = {
    "camera": "cam_02",
    "fault": "clock",
    "text": "x",
    "z": 12.3,
    "values": {"offset_s": {"value": 0.04, "low": 0.03, "high": 0.05, "unit": "s"}},
}
CASES = [
    (
        diagnosis("EFFECT", "adhesion"),
        "is missing is adhesion (the tool is sticky): it explains 96 % of the error, and "
        "chance alone would do that about once in 200 tries",
    ),
    (diagnosis("EFFECT", "adhesion", share=0.4), "it explains 40 % of the error"),
    (
        diagnosis("EFFECT", "adhesion", "viscosity", share=0.99),
        "together they explain 99 % of the error, and chance alone would do that about once in 67 tries",
    ),
    (diagnosis("PARTLY", "adhesion"), "part of what is wrong with base is adhesion"),
    (diagnosis("PARTLY", "adhesion", "viscosity", alternatives=["viscosity"]), "cannot tell apart"),
    (diagnosis("PARTLY", "stiffness", base=0.4), "is its stiffness: it explains 40 % of the error"),
    (
        diagnosis("BASE PARAMETER", "stiffness", base=0.6, rest=False),
        "no law is missing from base, but its stiffness "
        "is off (it should be 1.35 times as large): changing it explains 60 % of the error",
    ),
    (diagnosis("BASE PARAMETER", "stiffness", base=0.6, rest=True), "though what is left is still more"),
    (diagnosis("BASE PARAMETER", "stiffness", base=0.6, alternatives=["density"]), "stiffness or density of base"),
    (
        diagnosis("CONFOUNDED", "adhesion", "viscosity", alternatives=["viscosity"]),
        "either adhesion (the tool is "
        "sticky) or viscosity (the material resists fast deformation) is missing from base, but these motions cannot",
    ),
    (diagnosis("CONFOUNDED", "stiffness", "viscosity", base=0.5, share=0.5), "either the stiffness of base is off or"),
    (
        diagnosis("NONE OF THESE", excess_p=0.001),
        "none of the 3 laws that were tried explains any of it with "
        "certainty: the error is 5.5 times as large as in the recordings where nothing is missing, which chance "
        "alone would cause about once in 1,000 tries",
    ),
    (diagnosis("NONE OF THESE", lone={"effect": "adhesion", "episode": "block_2"}), "only block_2 points to adhesion"),
    (diagnosis("NONE OF THESE", decoys=["drag"]) | {"floor": None}, "best is drag"),
    (diagnosis("NOTHING DETECTABLE"), "more than 1.3 mm would have been found about nine times in ten, but for 1 of 3"),
    (diagnosis("NOTHING DETECTABLE", excess_p=0.03), "although the error is 5.5 times"),
    (diagnosis("NOTHING DETECTABLE") | {"limits": {}}, "could not have shown any"),
    (
        diagnosis("SENSOR", "x", sensors=(CLOCK,)),
        "camera cam_02 is faulty (the camera's clock is late or early, 0.04 s)",
    ),
    (
        diagnosis("SENSOR", "x", sensors=(CLOCK, {"camera": "cam_03", "fault": "own_fault"})),
        "cam_03 is faulty (own fault",
    ),
]


@pytest.mark.parametrize(("found", "words"), CASES)
def test_it_is_one_plain_sentence_that_says_what_is_found(found, words):
    said = headline("base", found)
    assert words in said[0].lower() + said[1:] and said[0].isupper()
    assert len(re.findall(r"[.!?](?=\s|$)", said)) == 1 and said.endswith(".")
    plain = said.replace("block_2", "").replace("cam_0", "")  # names of the user's own
    assert not re.search(r"p [=<]|±|_|residual|whitened|sham", plain), said
    assert not re.search(r"-\d", said), "no share is negative"


def test_an_old_diagnosis_and_an_unknown_kind_are_told_too():
    assert headline("base", diagnosis("SOMETHING NEW")) == "Sentence. Another."
    found = diagnosis("EFFECT", "adhesion")
    del found["verdict"]["evidence"], found["limits"]
    found["ranking"][0]["p"] = None
    assert "how sure that is was not tested" in headline("base", found)
