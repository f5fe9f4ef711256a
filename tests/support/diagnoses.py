"""Diagnoses made by hand: what a test does not say is quiet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from plop.diagnosis.decision.result import Diagnosis, Ranked, SensorFault
from plop.diagnosis.decision.verdict import Grounds, Verdict, VerdictKind
from plop.parameters import Estimate


def ranked(effect: str, parameters: Mapping[str, Estimate] | None = None, **changes: Any) -> Ranked:
    """One law, found with 70 % of the error and p = 0.005, that passes."""
    known: dict[str, Any] = {
        "kind": "physics",
        "help": "",
        "law": "",
        "source": "",
        "gain": 0.7,
        "gain_error": 0.05,
        "strength": 40.0,
        "gains": (300.0, 250.0, 280.0, 260.0, 300.0, 200.0),
        "p": 0.005,
        "size_mm": 1.5,
        "reasons": (),
        **changes,
    }
    return Ranked(effect, parameters=parameters or {}, passes=not known["reasons"], **known)


def base(**changes: Any) -> Ranked:
    """The stiffness, which does not help."""
    parameters = {"d_ln_e": Estimate(0.3, 0.2, 0.4, "-")}
    return ranked("stiffness", parameters, **{"kind": "base", "gain": -2.0, "gain_error": 3.1, "p": 1.0, **changes})


def verdict(kind: str, *named: str, text: str = "It is said in one sentence.", **evidence: Any) -> Verdict:
    """A verdict of this kind."""
    return Verdict(VerdictKind(kind), named, text, Grounds(**evidence))


def diagnosis(said: Verdict, *ranking: Ranked, **changes: Any) -> Diagnosis:
    """A diagnosis of one episode, with an error of 6 where 1.1 is expected; the stiffness is ranked last."""
    known: dict[str, Any] = {
        "limits": {},
        "sensors": (),
        "searches": 200,
        "error": 6.0,
        "floor": 1.1,
        "next_step": "",
        "episodes": ("box_000",),
        "repeats": {},
        "reference_episodes": (),
        "dropped": {},
        "environment": "box",
        **changes,
    }
    stiffness = () if any(row.effect == "stiffness" for row in ranking) else (base(),)
    return Diagnosis(verdict=said, ranking=(*ranking, *stiffness), **known)


def clock(camera: str = "cam_02", fault: str = "clock") -> SensorFault:
    """A camera whose clock is 40 ms off."""
    return SensorFault(camera, fault, "x", 12.3, {"offset_s": Estimate(0.04, 0.03, 0.05, "s")}, ())
