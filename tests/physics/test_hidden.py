"""What a user wants hidden: read, drawn, scaled to a signal, sealed."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plop.errors import PlopError, SignalTooWeakError
from plop.physics.effects.library import library
from plop.physics.hidden.choose import choose
from plop.physics.hidden.response import Response, scaled_to
from plop.physics.hidden.wish import parse_hidden
from plop.physics.scenes import find_scene
from plop.physics.scenes.scene import Scene, simulate_episode
from plop.physics.scenes.sealed import open_answer, seal_answer


def test_hidden_effects_are_read_as_typed():
    (one,) = parse_hidden(["viscosity=40"])
    assert one.scaled(1.0).values == {"viscosity_pa_s": 40.0} and one.scaled(0.5)["viscosity_pa_s"] == 20
    tilt, relaxation, drawn = parse_hidden(["tilt.gx_m_s2=0.5", "relaxation.tau_s=0.3", "random", "tilt.gy_m_s2=-0.25"])
    assert tilt.scaled(2.0).values == {"gx_m_s2": 1.0, "gy_m_s2": -0.5}
    assert relaxation.scaled(1.0)["tau_s"] == 0.3 and relaxation.scaled(1.0)["ratio"] > 0, "typical when not given"
    assert drawn.effect is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("viscocity=40", "Did you mean viscosity"),
        ("viscosity=much", "EFFECT=AMPLITUDE"),
        ("viscosity.eta=4", "no such parameter"),
        ("viscosity=1e9", "out of range"),
        ("viscosity=nan", "out of range"),
    ],
)
def test_bad_wishes_are_refused(text, message):
    with pytest.raises(PlopError, match=message):
        parse_hidden([text])


class Curve:
    """A response that is known: a power of the amplitude, unstable beyond a limit."""

    def __init__(self, power=1.0, gain=1e-5, stable_below=np.inf):
        self.power, self.gain, self.stable_below, self.asked = power, gain, stable_below, 0

    def affordable(self, wish):
        return wish.most()

    def rms_m(self, effect):
        self.asked += 1
        value = effect["viscosity_pa_s"]
        if value > self.stable_below:
            raise PlopError("unstable")
        return self.gain * value**self.power


@pytest.mark.parametrize("curve", [Curve(), Curve(0.6), Curve(1.8, 1e-7), Curve(stable_below=30.0)])
def test_the_amplitude_gives_the_wanted_signal(curve):
    (wish,) = parse_hidden(["viscosity=100"])
    wanted = 2e-4 if curve.power != 1.8 else 5e-5
    found = scaled_to(curve, wish, wanted)
    assert curve.rms_m(found) == pytest.approx(wanted, rel=0.06)
    assert curve.asked <= 9


def test_shorter_time_steps_are_no_response():
    """Cohesion acts on cut faces, and nothing is cut."""
    scene = replace(Scene.read(find_scene(Path("block.toml"))), spacing_m=0.009, dx_m=0.018, episodes=2)
    cohesion = library()["cohesion"](traction_pa=1500.0)
    response = Response(scene)
    plain, acted = (simulate_episode(scene, 1, effects).vertices for effects in ((), (cohesion,)))
    alone = np.sqrt(((acted - plain) ** 2).mean())
    total, count = response.squares(1, acted, (cohesion,))
    assert alone > 1e-5 and np.sqrt(total / count) < 0.2 * alone


BOTH_WAYS = """
from dataclasses import replace
from plop.physics.hidden.response import Response
from plop.physics.scenes.scene import Scene
from plop.physics.scenes import find_scene
from plop.physics.hidden.wish import parse_hidden
from pathlib import Path

scene = replace(Scene.read(find_scene(Path("block.toml"))), spacing_m=0.009, dx_m=0.018, episodes=2)
(wish,) = parse_hidden(["viscosity=20"])
for jobs in (1, 2):
    response = Response(scene, jobs=jobs)
    print([response.rms_m(wish.scaled(1.0)) for _ in range(2)])
"""


def test_the_number_of_processes_changes_no_digit():
    """In a process that finds all kernels compiled: the run that compiles them may differ in the last digit."""
    for _ in ("compiles them, perhaps", "loads them"):
        said = subprocess.run(
            [sys.executable, "-c", BOTH_WAYS],
            cwd=Path(__file__).resolve().parents[2],
            check=True,
            capture_output=True,
            text=True,
        ).stdout.splitlines()
    alone, side_by_side = map(json.loads, said)
    assert alone == side_by_side and alone[0] == alone[1] > 1e-5


def test_a_signal_out_of_reach_is_not_claimed():
    (wish,) = parse_hidden(["viscosity"])
    weak = Curve(gain=1e-8)
    assert scaled_to(weak, wish, 1e-2) is None and weak.asked == 1, "one look is enough"


class EveryEffect:
    """A response in proportion to the factor, for any effect."""

    def __init__(self, scene, *, jobs):
        self.scene = scene

    def affordable(self, wish):
        return min(wish.most(), 20.0)

    def rms_m(self, effect):
        return 1e-3 * float(np.mean([abs(effect[p.name]) / (p.typical or p.step) for p in effect.amplitudes]))


def test_random_draws_are_repeatable_various_and_never_decoys(monkeypatch):
    monkeypatch.setattr("plop.physics.hidden.choose.Response", EveryEffect)
    known, names = library(), []
    for seed in range(24):
        scene = Scene(seed=seed)
        one, again = (
            [
                repr(effect)
                for effect in choose(
                    scene, parse_hidden(["random", "random"]), snr=0.0, noise_floor_m=1e-3, effects=known
                )
            ]
            for _ in range(2)
        )
        assert one == again and len({text.partition("(")[0] for text in one}) == 2
        names += [text.partition("(")[0] for text in one]
    assert {known[name].kind for name in names} == {"physics"} and len(set(names)) >= 6


def test_too_much_signal_is_an_error_that_says_how_much_is_possible(monkeypatch):
    monkeypatch.setattr("plop.physics.hidden.choose.Response", EveryEffect)
    with pytest.raises(SignalTooWeakError, match="cannot give the requested signal") as caught:
        choose(Scene(), parse_hidden(["viscosity"]), snr=1e4, noise_floor_m=1e-3, effects=library())
    assert "SNR" in str(caught.value.found)


def test_the_answer_is_sealed_and_opens(tmp_path):
    path = seal_answer(tmp_path, {"effects": {"viscosity": {"viscosity_pa_s": 40.0}}})
    assert "viscosity" not in path.read_text()
    assert open_answer(tmp_path) == open_answer(path) == {"effects": {"viscosity": {"viscosity_pa_s": 40.0}}}
    path.write_text('{"sealed": "###"}')
    with pytest.raises(PlopError, match="no sealed answer"):
        open_answer(path)
