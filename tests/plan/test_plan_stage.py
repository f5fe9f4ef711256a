"""The stage on small recordings: what it writes, that a second run needs no engine, and what it refuses."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plop.errors import PlopError
from plop.parameters import Estimate
from plop.pipeline.stage import Input, Inputs, Output
from plop.planning.result import Plan
from stages.plan.stage import PlanConfig, check, check_inputs, run
from tests.support.diagnoses import diagnosis, ranked, verdict
from tests.support.tracked_set import write_engine, write_recordings

CONFIG = PlanConfig(
    effects=("swelling",), between=("table_friction", "blade_friction"), vary=("slower",), repeats=1, jobs=1
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("set")


@pytest.fixture(scope="module")
def inputs(folder: Path) -> Inputs:
    return {**write_recordings(folder, 4), "model": write_engine(folder / "model")}


def given(folder: Path, kind: str, *named: str, environment: str = "block", at_bound: bool = False) -> Input:
    """Write a diagnosis."""
    parameters = {"d_mu": Estimate(0.5, 0.4, 0.6, "-", at_bound)}
    rows = [ranked(name, parameters) for name in named]
    made = diagnosis(verdict(kind, *named, alternatives=named[1:]), *rows, environment=environment)
    folder.mkdir()
    made.write(folder)
    return Input(folder)


def test_a_plan_is_written_read_again_and_remade_without_the_engine(inputs, tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    summary = run(inputs, CONFIG, Output(first))
    kept = Plan.load(first)
    assert summary.figures["engine_runs"] > 20 and summary.figures["plan"] == kept.text
    assert kept.text in (first / "protocol.md").read_text() and kept.environment == "block"
    assert {law.effect for law in kept.laws} >= {"swelling", "table_friction", "blade_friction", "stiffness"}
    assert kept.ways == (70,)
    assert kept.separation is not None and len(kept.separation.choices) >= 6
    for step in kept.steps:
        assert bool(step.file) == (step.change != "as recorded")
        if step.file:
            rows = np.loadtxt(first / step.file, delimiter=",", skiprows=1)
            assert rows.shape[1] == 8 and np.allclose(np.linalg.norm(rows[:, 4:], axis=1), 1, atol=1e-5)
    second.mkdir()
    shutil.copytree(first / ".jobs", second / ".jobs")
    assert run(inputs, CONFIG, Output(second)).figures["engine_runs"] == 0
    assert (first / "plan.json").read_bytes() == (second / "plan.json").read_bytes()


def test_what_a_diagnosis_leaves_open_is_planned(inputs, tmp_path):
    found = given(tmp_path / "verdict", "CONFOUNDED", "table_friction", "blade_friction")
    (tmp_path / "out").mkdir()
    made = run({**inputs, "diagnosis": found}, replace(CONFIG, between=()), Output(tmp_path / "out"))
    kept = Plan.load(tmp_path / "out")
    assert not [warning for warning in made.warnings if "end of the range" in warning]
    assert kept.separation.laws == ("table_friction", "blade_friction") and kept.laws == ()
    assert [step.motion for step in kept.steps] == [kept.separation.motion]
    assert "diagnose again" in kept.text


def test_a_law_at_the_end_of_its_range_is_said_to_be_settled_less_often(inputs, tmp_path):
    found = given(tmp_path / "verdict", "PARTLY", "table_friction", "blade_friction", at_bound=True)
    (tmp_path / "out").mkdir()
    made = run({**inputs, "diagnosis": found}, replace(CONFIG, between=(), vary=("none",)), Output(tmp_path / "out"))
    assert [warning for warning in made.warnings if warning.startswith("table_friction and blade_friction: found at")]


def test_what_cannot_be_planned_is_refused_in_words(inputs, tmp_path):
    plain = replace(CONFIG, between=())
    other = given(tmp_path / "other", "CONFOUNDED", "table_friction", "blade_friction", environment="sphere")
    with pytest.raises(PlopError, match="of another object") as caught:
        check_inputs({**inputs, "diagnosis": other}, plain)
    assert (caught.value.expected, caught.value.found) == ("block", "sphere")
    nothing = given(tmp_path / "nothing", "NOTHING DETECTABLE")
    with pytest.raises(PlopError, match="nothing to distinguish"):
        check_inputs({**inputs, "diagnosis": nothing}, plain)
    with pytest.raises(PlopError, match="different objects"):
        check_inputs({**inputs, "model": write_engine(tmp_path / "ball", "sphere")}, plain)
    with pytest.raises(PlopError, match="no such effect") as caught:
        check(replace(CONFIG, between=("tilt", "table_fricton")), {})
    assert "table_friction" in caught.value.fix
    with pytest.raises(PlopError, match="Both --between and --diagnosis"):
        check(CONFIG, {"diagnosis": "x"})
    for wrong in ({"between": ("tilt",)}, {"between": ("tilt", "tilt")}, {"vary": ("sideways",)}):
        with pytest.raises(PlopError):
            PlanConfig(**wrong)


def test_a_network_needs_the_engine_beside_it(inputs, tmp_path):
    model = tmp_path / "model"
    shutil.copytree(inputs["model"].path, model)
    facts = json.loads((model / "model.json").read_text())
    del facts["engine"]
    (model / "model.json").write_text(json.dumps({**facts, "kind": "plop"}))
    with pytest.raises(PlopError, match="needs the engine beside it"):
        run({**inputs, "model": Input(model)}, replace(CONFIG, between=()), Output(tmp_path))


def test_three_episodes_are_too_few(folder, inputs, tmp_path):
    few = write_recordings(tmp_path, 3)
    with pytest.raises(PlopError, match="too few episodes"):
        check_inputs({**few, "model": inputs["model"]}, CONFIG)
