"""Every effect of the library as a program: its text, its units, its manners; and a user's file with errors."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from plop.errors import PlopError
from plop.physics.effects.effect import at_rest
from plop.physics.effects.library import effect_type, library
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.engine import Engine
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.tools import blade_mesh

EFFECTS = library()
MATERIAL = Material(youngs_modulus_pa=6e3, tool_friction=0.2, table_friction=0.3, damping_per_s=5)
CONFIG = EngineConfig(dx_m=0.01, dt_s=4e-4)
FIRST = {
    "tilt",
    "table_friction",
    "blade_friction",
    "adhesion",
    "viscosity",
    "plasticity",
    "fibres",
    "stiffening",
    "swelling",
    "toughness",
    "softening",
    "relaxation",
    "drag",
    "inertia",
    "stiffness",
    "damping",
    "density",
    "cohesion",
    "graded",
    "layered",
    "crust",
}
IN_A_CUT = {"toughness", "cohesion"}
"""What a press does not show."""


def typical(name: str):
    effect = EFFECTS[name]
    return effect(**{p.name: p.typical for p in effect.amplitudes}, **effect.variants[0])


@pytest.fixture(scope="module")
def press(block, plate):
    """Throw a block to the side while a plate presses it, or a blade cuts and opens it; two tracers ride along."""
    body = block((0.04, 0.03, 0.03), 0.005)
    middle = body.positions[[100, 150]] + 0.001
    positions, volumes = np.concatenate([body.positions, middle]), np.append(body.volumes, [0.0, 0.0])
    velocities = np.tile([0.15, 0, 0], (len(positions), 1))
    motion = plate((0, 0.0302), (0.004, 0.027), (0.004, 0.027), (0.004, 0.031), times=[0, 0.04, 0.05, 0.06])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, [0, 2], 3] = (0, 0.031), (0.005, -0.005), (0.008, -0.005)
    blade = ToolMotion(*blade_mesh(), np.array([0, 0.05, 0.07]), poses)

    def run(effects, times=(0, 0.05, 0.07), start=None, order=None, cut=False):
        particles = start or Particles(positions, volumes, velocities)
        if order is not None:
            particles = Particles(positions[order], volumes[order], velocities[order])
        return simulate(particles, MATERIAL, blade if cut else motion, np.array(times), CONFIG, effects=effects)

    return run


def test_the_first_library_is_whole():
    assert set(EFFECTS) >= FIRST
    assert {name for name, e in EFFECTS.items() if e.kind == "decoy"} == {"drag", "inertia"}
    assert {name for name, e in EFFECTS.items() if e.kind == "base"} == {"stiffness", "damping", "density"}


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_every_effect_says_what_it_is(name):
    effect = EFFECTS[name]
    assert effect.law and effect.source and effect.help and effect.__doc__ and effect.amplitudes
    assert effect().absent and not typical(name).absent
    for p in effect.amplitudes:
        assert p.low <= 0 <= p.high and p.default == 0 and p.unit and p.help
        assert 0 < p.step < abs(p.typical) and p.low <= p.typical <= p.high
    assert all(p.step == 0 and p.unit and p.help for p in effect.shapes)
    for variant in effect.variants:
        assert set(variant) <= {p.name for p in effect.shapes} and effect(**variant).absent
    for p in effect.parameters():
        for value in (p.high * 2 + 1, np.nan):
            with pytest.raises(PlopError, match="out of range") as caught:
                effect(**{p.name: value})
            assert caught.value.where == f"{name}.{p.name}" and p.unit in str(caught.value.expected)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_every_effect_keeps_its_memory_and_leaves_tracers_alone(name, press):
    effect, press = typical(name), partial(press, cut=name in IN_A_CUT)
    whole = press([effect])
    assert np.isfinite(whole.positions).all() and np.isfinite(whole.F).all()
    shuffle = np.random.default_rng(0).permutation(len(whole.positions[0]))
    mixed = press([effect], order=shuffle)
    np.testing.assert_allclose(mixed.positions, whole.positions[:, shuffle], atol=2e-6)
    half = press([effect], times=(0, 0.05))
    rest = press([effect], times=(0.05, 0.07), start=half.final)
    np.testing.assert_allclose(rest.positions[-1], whole.positions[-1], atol=2e-6)
    if effect.remembers:
        forgetful = press([effect], times=(0.05, 0.07), start=replace(half.final, memory=None))
        assert np.abs(forgetful.positions[-1] - whole.positions[-1]).max() > 5e-6
    moved = whole.positions[-1] - whole.positions[0]
    np.testing.assert_allclose(moved[-2:], moved[[100, 150]], atol=4e-4)


def test_an_absent_effect_costs_nothing_and_changes_nothing(press):
    plain, absent = press([]), press([effect() for effect in EFFECTS.values()])
    assert (plain.positions == absent.positions).all()


def test_effects_add_up(press):
    """Two forces and two stresses at once: nobody overwrites what another has added."""
    names = ["fibres", "stiffening", "drag", "tilt", "relaxation"]
    plain = press([]).positions
    small = [EFFECTS[n](**{p.name: 0.2 * p.step for p in EFFECTS[n].amplitudes}) for n in names]
    total = sum(press([effect]).positions - plain for effect in small)
    together = press(small).positions - plain
    # contact is not smooth: a few particles at the plate answer otherwise to the sum
    assert np.sqrt(((together - total) ** 2).mean()) < 0.1 * np.sqrt((together**2).mean())


def test_a_name_that_does_not_exist_is_answered_with_the_nearest():
    with pytest.raises(PlopError, match="no such effect") as caught:
        effect_type("viscocity")
    assert "viscosity" in str(caught.value.fix)


USER = """from plop.physics.effects.effect import Effect, Parameter

class Mine(Effect):
    name = "mine"
    help = law = source = "mine"
    amplitudes = (Parameter("a", "-", -1.0, 1.0, step=0.1, typical=0.5),)
    {hook}
        {body}
"""
BEFORE, STRESS, AFTER = (f"def {hook}(self, body, dt):" for hook in ("before", "stress", "after"))


@pytest.fixture
def run_user_file(tmp_path, block, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(hook: str, body: str):
        (tmp_path / "mine.py").write_text(USER.format(hook=hook, body=body))
        effect = library(["mine.py"])["mine"](a=0.5)
        return simulate(
            block((0.02, 0.02, 0.02), 0.005),
            Material(),
            None,
            np.array([0, 0.01]),
            EngineConfig(dx_m=0.01),
            effects=[effect],
        )

    return run


@pytest.mark.parametrize(
    "hook",
    [
        BEFORE,
        STRESS,
        AFTER,
        "def material(self, material):",
        "def config(self, config):",
        "def slowest_step_s(self, material, config):",
    ],
)
def test_an_error_in_a_user_s_hook_names_its_line(run_user_file, hook):
    with pytest.raises(PlopError, match="error") as caught:
        run_user_file(hook, "x = 1 + undefined_name")
    assert "mine.py, line 8" in str(caught.value.where) and "undefined_name" in str(caught.value.found)


@pytest.mark.parametrize(
    ("hook", "body"),
    [
        (BEFORE, "body.v[3] = float('nan')"),
        (STRESS, "body.extra[2] += 1e38 * 10"),
        (AFTER, "body.f /= 0 * body.f"),
        (AFTER, "body.x[0] = float('inf')"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_numbers_that_are_not_finite_name_the_effect(run_user_file, hook, body):
    with pytest.raises(PlopError, match="unstable") as caught:
        run_user_file(hook, body)
    assert "effect mine" in str(caught.value.where) and "mine(a=0.5)" in str(caught.value.found)


@pytest.mark.parametrize(
    ("hook", "body"),
    [
        (BEFORE, "body.v = body.v * 1.5j"),
        (STRESS, "body.extra = body.extra[:, :3]"),
        (AFTER, "body.f = 1.0 * body.f.T"),
        ("def material(self, material):", "return None"),
        ("def slowest_step_s(self, material, config):", "return -1.0"),
    ],
)
def test_a_hook_that_does_something_else_is_refused(run_user_file, hook, body):
    with pytest.raises(PlopError, match="hook of an effect") as caught:
        run_user_file(hook, body)
    assert str(caught.value.where).startswith("mine.")


@pytest.mark.parametrize(("body", "told"), [("return None", "an effect mine"), ("return self.rested", "line 8")])
def test_a_law_at_rest_is_that_law(tmp_path, monkeypatch, body, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(USER.format(hook="def at_rest(self):", body=body))
    with pytest.raises(PlopError) as caught:
        at_rest([library(["mine.py"])["mine"](a=0.5)])
    assert told in f"{caught.value.where} {caught.value.expected}"


@pytest.mark.parametrize("base", ["viscosity", "relaxation", "swelling"])
def test_a_law_of_one_s_own_may_be_a_kind_of_the_library_s(tmp_path, base):
    path = tmp_path / "mine.py"
    path.write_text(
        f"from plop.physics.effects.{base} import {base.title()}\n\n\nclass Mine({base.title()}):\n    name = 'mine'\n"
    )
    kind = library([path])["mine"]
    law = kind(**{kind.amplitudes[0].name: kind.amplitudes[0].typical})
    (resting,) = at_rest([law])
    assert type(resting) is kind and (resting.absent or resting.values == law.values)


def test_a_private_class_is_a_base_of_effects_and_none_itself(tmp_path):
    path = tmp_path / "mine.py"
    text = USER.format(hook=BEFORE, body="pass")
    path.write_text(
        text.replace("(Effect):", "(_Base):", 1).replace("class ", "class _Base(Effect):\n    pass\n\n\nclass ", 1)
    )
    assert "_Base(Effect)" in path.read_text() and {*library([path])} == {*library(), "mine"}


def test_a_broken_file_names_its_line_and_a_taken_name_is_refused(tmp_path):
    path = tmp_path / "broken.py"
    outside = "from plop.physics.effects.effect import Parameter\nParameter('a', '-', 0.0, 1.0, step=0.1, {})\n"
    for text, where in [
        ("x = 1\ny = (\n", "line 2"),
        ("x = 1\n\nraise ValueError('no')\n", "line 3"),
        (outside.format("typical=2.0"), "line 2"),
        (outside.format("tried=(0.5, -0.1)"), "line 2"),
    ]:
        path.write_text(text)
        with pytest.raises(PlopError, match="error") as caught:
            library([path])
        assert where in str(caught.value.where)
    path.write_text("x = 1\n")
    with pytest.raises(PlopError, match="defines no effect"):
        library([path])
    path.write_text(USER.format(hook=BEFORE, body="pass").replace('"mine"', '"drag"', 1))
    with pytest.raises(PlopError, match="same name") as caught:
        library([path])
    assert "line 4" in str(caught.value.where)
    with pytest.raises(PlopError, match="no such effect file"):
        library([tmp_path / "nothing.py"])


def test_an_unstable_run_lists_the_effects_that_act(block):
    fast = EFFECTS["tilt"](gx_m_s2=1.0)
    with pytest.raises(PlopError, match="unstable") as caught:
        simulate(
            block((0.04, 0.03, 0.03), 0.005),
            Material(youngs_modulus_pa=1e6),
            None,
            np.array([0, 0.2]),
            EngineConfig(dx_m=0.01, dt_s=2e-3),
            effects=[fast],
        )
    assert "tilt(gx_m_s2=1" in str(caught.value.found)


def test_an_unstable_run_blames_the_effect_and_not_the_material(run_user_file):
    with pytest.raises(PlopError, match="unstable") as caught:
        run_user_file(BEFORE, "body.v *= 1 + 1e5 * dt")
    assert str(caught.value.where).startswith("effect mine") and "youngs" not in str(caught.value)
    assert "mine(a=0.5)" in str(caught.value.found) and "smaller amplitude" in str(caught.value.fix)


def test_an_effect_that_needs_endless_time_steps_is_refused(run_user_file):
    with pytest.raises(PlopError, match="too many time steps") as caught:
        run_user_file("def slowest_step_s(self, material, config):", "return 1e-9")
    assert caught.value.where == "effect mine(a=0.5)" and "1000.0 million steps" in str(caught.value.found)


def test_effects_that_are_absent_are_not_in_the_engine(block):
    engine = Engine(block((0.02, 0.02, 0.02), 0.005), Material(), None, EngineConfig(), [EFFECTS["drag"]()])
    assert not engine.effects and engine.extra.shape == (0, 6)
