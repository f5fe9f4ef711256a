"""The benchmark on followed points hides what it says, and adds what was named as it was fitted."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks.missing_physics import points
from benchmarks.missing_physics.plan import DEVELOPED, SNRS, Run, points_plan
from benchmarks.missing_physics.points import Points, fitted_engine, named_effects
from benchmarks.missing_physics.row import Group, Row
from plop.diagnosis.verdict import Verdict
from plop.errors import PlopError, SignalTooWeakError
from plop.parameters import Estimate
from plop.physics.effects.library import library

TYPES = library()
TILT = {"tilt": {"gx_m_s2": 1.0}}


def run_of(name: str) -> Run:
    return next(run for run in points_plan() if run.name == name)


def found(kind: str, named: list[str]) -> SimpleNamespace:
    """What a diagnosis holds, as far as the next round reads it."""
    parameters = {
        "swelling": {"rate_per_s": 0.1},
        "fibres": {"ratio": 2.0, "angle_deg": 45.0},
        "stiffness": {"d_ln_e": -0.4},
    }
    findings = [
        SimpleNamespace(name=name, parameters={k: Estimate(v) for k, v in values.items()})
        for name, values in parameters.items()
    ]
    return SimpleNamespace(verdict=Verdict(kind, named, ""), findings=findings)


SWELLING, FIBRES = ("swelling", {"rate_per_s": 0.1}), ("fibres", {"ratio": 2.0, "angle_deg": 45.0})


@pytest.mark.parametrize(
    "kind, named, added",
    [
        ("EFFECT", ["swelling", "fibres"], [SWELLING, FIBRES]),
        ("CONFOUNDED", ["fibres", "swelling"], [FIBRES]),
        ("BASE PARAMETER", ["stiffness"], [("stiffness", {"d_ln_e": -0.4})]),
        ("NOTHING DETECTABLE", [], []),
        ("SENSOR", ["cam_01"], []),
    ],
)
def test_what_was_named_is_added(kind, named, added):
    assert [(e.name, e.values) for e in named_effects(found(kind, named), TYPES)] == added


def test_the_plan_has_each_effect_at_each_signal_and_no_seed_twice():
    plan = points_plan()
    assert len({run.seed for run in plan}) == len({run.name for run in plan}) == len(plan)
    assert {run.name for run in plan} >= DEVELOPED
    assert not any(name.startswith("outside-fresh") for name in DEVELOPED)
    for snr in SNRS:
        wanted = {run.hidden[0][0] for run in plan if run.group is Group.SINGLE and run.snr == snr}
        known = {name for name, kind in TYPES.items() if kind.kind == "physics"}
        assert wanted == known - {"cohesion"}, "a law that came after the plan, whose runs are stored"


def test_runs_of_two_engines_do_not_mix(tmp_path: Path):
    (tmp_path / "base.json").write_text(json.dumps({"engine": {}, "particles": 570}))
    with pytest.raises(PlopError, match="another engine"):
        fitted_engine(tmp_path, 1, 1300)


def test_what_an_earlier_version_hid_is_hidden_again(tmp_path: Path):
    earlier = Row("snr4-tilt", Group.SINGLE, 1, TILT, 4.0, "EFFECT", ["tilt"])
    hidden = Points(tmp_path, jobs=1).hidden(run_of("snr4-tilt"), earlier)
    assert [(e.name, e.values["gx_m_s2"]) for e in hidden] == [("tilt", 1.0)]


def test_half_the_signal_is_taken_where_the_whole_cannot_be_had(tmp_path: Path, monkeypatch):
    strongest, asked = 3.0, []

    def choose(scene, wishes, *, snr, **_):
        asked.append((scene.seed, snr))
        if snr > strongest:
            raise SignalTooWeakError("too weak")
        return [wish.scaled(1.0) for wish in wishes]

    monkeypatch.setattr(points, "choose", choose)
    run = run_of("snr4-swelling")
    benchmark = Points(tmp_path, jobs=1)
    assert [e.name for e in benchmark.hidden(run, None)] == ["swelling"]
    assert asked == [(run.seed, 4.0), (run.seed, 2.0)]
    strongest = 1.0
    row = benchmark.carry_out(run, None)
    assert (row.set, row.hidden, row.wanted) == (Group.UNREACHABLE, {"swelling": {}}, 4.0)
