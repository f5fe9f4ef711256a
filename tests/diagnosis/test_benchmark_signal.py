"""The benchmark hides what it says: amplitudes are scaled to a signal, and what was named is added as it was fitted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.physics_plan import PLAN, SNRS
from benchmarks.physics_points import fitted_engine
from benchmarks.physics_rounds import named_effects
from benchmarks.physics_signal import CLOSE, at_signal
from plop.diagnosis.finding import Finding
from plop.diagnosis.verdict import Verdict, VerdictKind
from plop.errors import PlopError
from plop.parameters import Estimate
from plop.physics.effects.library import library

TYPES = library()


@pytest.mark.parametrize("exponent", [0.3, 1.0, 1.7])
def test_the_amplitude_of_a_signal_is_found(exponent):
    start = {"growth": 100.0}
    effect, found = at_signal(TYPES["stiffening"], start, 2.0, lambda e: 2 * (e["growth"] / 300) ** exponent)
    assert 2 / CLOSE <= found <= 2 * CLOSE
    assert found == pytest.approx(2 * (effect["growth"] / 300) ** exponent)


def test_direction_and_shape_stay():
    effect, found = at_signal(TYPES["tilt"], {"gx_m_s2": -0.5, "gy_m_s2": 1.0}, 2.0, lambda e: abs(e["gx_m_s2"]))
    assert found == pytest.approx(2, rel=0.11) and effect["gy_m_s2"] == pytest.approx(-2 * effect["gx_m_s2"])
    fibres, _ = at_signal(TYPES["fibres"], {"ratio": 1.0, "angle_deg": 30.0}, 2.0, lambda e: e["ratio"])
    assert fibres["angle_deg"] == 30.0


def test_the_end_of_a_range_is_said():
    high = TYPES["blade_friction"].amplitudes[0].high
    effect, found = at_signal(TYPES["blade_friction"], {"d_mu": 1.0}, 4.0, lambda e: 0.03 * e["d_mu"])
    assert effect["d_mu"] == high and found == pytest.approx(0.03 * high)


def test_what_cannot_be_simulated_is_not_taken():
    def signal(effect):
        if effect["viscosity_pa_s"] > 50:
            raise PlopError("unstable")
        return effect["viscosity_pa_s"] / 20

    effect, found = at_signal(TYPES["viscosity"], {"viscosity_pa_s": 90.0}, 2.0, signal)
    assert effect["viscosity_pa_s"] <= 50 and found == pytest.approx(2.0, rel=0.11)
    with pytest.raises(PlopError, match="No amplitude"):
        at_signal(TYPES["viscosity"], {"viscosity_pa_s": 1e4}, 2.0, signal)


class Found:
    """What a diagnosis holds, as far as the next round reads it."""

    def __init__(self, kind: str, named: list[str]) -> None:
        parameters = {
            "swelling": {"rate_per_s": 0.1},
            "fibres": {"ratio": 2.0, "angle_deg": 45.0},
            "base": {"d_ln_e": -0.4, "d_per_s": 20.0},
        }
        self.verdict = Verdict(VerdictKind(kind), tuple(named), "")
        self.findings = [
            Finding(name, "physics", {k: Estimate(v) for k, v in values.items()}, 0.5, 0.1, 0.0, None)
            for name, values in parameters.items()
        ]


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
    assert [(e.name, e.values) for e in named_effects(Found(kind, named), TYPES)] == added


def test_the_plan_has_each_effect_at_each_signal_and_no_seed_twice():
    assert len({p.seed for p in PLAN}) == len({p.name for p in PLAN}) == len(PLAN)
    for snr in SNRS:
        wanted = {p.hidden[0][0] for p in PLAN if p.set == "single" and p.snr == snr}
        known = {name for name, kind in TYPES.items() if kind.kind == "physics"}
        assert wanted == known - {"cohesion"}, "a law that came after the plan, whose runs are stored"


def test_runs_of_two_engines_do_not_mix(tmp_path: Path):
    (tmp_path / "base.json").write_text(json.dumps({"engine": {}, "particles": 570}))
    with pytest.raises(PlopError, match="another engine"):
        fitted_engine(tmp_path, 1, 1300)
