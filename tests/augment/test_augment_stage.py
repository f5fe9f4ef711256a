"""An effect is added and taken out again: the base's files come back bit for bit; bad values are refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from plop.artifacts.digest import content_digest
from plop.artifacts.manifest import MANIFEST_NAME, Manifest, content_files
from plop.artifacts.result_file import SchemaError
from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.i2n.model_io import save_model
from plop.errors import PlopError
from plop.models import effects_of, load_model
from plop.parameters import Estimate
from plop.physics.adapters.augmented import AugmentedModel
from plop.physics.adapters.filled_model import FilledEngineModel
from plop.pipeline.stage import Input, Output
from stages.augment.stage import STAGE, AugmentConfig, run
from tests.support.diagnoses import diagnosis as made_diagnosis
from tests.support.diagnoses import ranked, verdict
from tests.support.tracked_set import write_engine


@pytest.fixture
def engine(tmp_path: Path) -> Input:
    return write_engine(tmp_path / "engine")


@pytest.fixture
def learned(tmp_path: Path) -> Input:
    folder = tmp_path / "learned"
    (folder / "logs").mkdir(parents=True)
    save_model(folder, PlopModel(PlopConfig()))
    (folder / "logs" / "loss.bin").write_bytes(b"\x00\x01")
    (folder / MANIFEST_NAME).write_text('{"when": "it was trained"}')
    return Input(folder)


def diagnosis(folder: Path, named: tuple[str, ...] = ("viscosity",), value: float = 40.0, **changes: float) -> Input:
    folder.mkdir(exist_ok=True)
    law = ranked("viscosity", {"viscosity_pa_s": Estimate(value, 30.0, 50.0, "Pa s")}, **changes)
    made_diagnosis(verdict("EFFECT", *named), law).write(folder)
    return Input(folder)


def out(folder: Path) -> Output:
    folder.mkdir()
    return Output(folder)


def files(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and p.name != MANIFEST_NAME
    }


def test_what_was_diagnosed_is_added_with_its_interval(engine, tmp_path):
    summary = run({"model": engine, "diagnosis": diagnosis(tmp_path / "d")}, AugmentConfig(), out(tmp_path / "a"))
    facts = json.loads((tmp_path / "a" / "model.json").read_text())
    value = Estimate(40.0, 30.0, 50.0, "Pa s").to_json()
    assert facts["kind"] == "augmented"
    assert facts["effects"] == [{"effect": "viscosity", "parameters": {"viscosity_pa_s": value}}]
    assert summary.table == [{"effect": "viscosity", "parameter": "viscosity_pa_s", **value}]
    assert facts["training"]["environment"] == "block"
    model = load_model(tmp_path / "a")
    assert isinstance(model, FilledEngineModel) and model.effects[0]["viscosity_pa_s"] == 40.0


def test_numbers_that_were_given_have_the_units_of_their_law(engine, tmp_path):
    given = ("traction_pa=500", "release_s=0.2")
    summary = run({"model": engine}, AugmentConfig("adhesion", given), out(tmp_path / "a"))
    assert {row["parameter"]: row["unit"] for row in summary.table} == {"traction_pa": "Pa", "release_s": "s"}


def test_adding_and_removing_gives_the_same_files_back(learned, engine, tmp_path):
    inputs = {"model": learned, "engine": engine}
    run(inputs, AugmentConfig("tilt", ("gx_m_s2=1",)), out(tmp_path / "a"))
    assert isinstance(load_model(tmp_path / "a"), AugmentedModel)
    assert not list((tmp_path / "a").rglob(MANIFEST_NAME))  # the same base and effect give the same artifact
    run({"model": Input(tmp_path / "a")}, AugmentConfig("viscosity", ("viscosity_pa_s=5",)), out(tmp_path / "b"))
    assert [e.name for e in effects_of(tmp_path / "b")] == ["tilt", "viscosity"]
    run({"model": Input(tmp_path / "b")}, AugmentConfig(remove=True), out(tmp_path / "c"))
    assert files(tmp_path / "c") == files(tmp_path / "a")
    summary = run({"model": Input(tmp_path / "c")}, AugmentConfig(remove=True), out(tmp_path / "d"))
    logs = {"logs/loss.bin"}  # they hold clocks, and no model needs them
    assert files(tmp_path / "d") == {name: text for name, text in files(learned.path).items() if name not in logs}
    assert summary.figures == {"effects": "none"}


def test_logs_of_the_training_are_not_copied(learned, engine, tmp_path):
    base = tmp_path / "base"
    shutil.copytree(learned.path, base)
    for folder in (base / "tensorboard", base / "folds" / "0" / "tensorboard"):
        folder.mkdir(parents=True)
        (folder / "events").write_text("12:00")
    inputs = {"model": Input(base), "engine": engine}
    run(inputs, AugmentConfig("tilt", ("gx_m_s2=1",)), out(tmp_path / "a"))
    assert (base / "tensorboard" / "events").is_file() and not list((tmp_path / "a").rglob("tensorboard"))


def test_a_base_parameter_is_added_and_removed_like_a_law(engine, learned, tmp_path):
    found = diagnosis(tmp_path / "d", ("stiffness",))
    run({"model": engine, "diagnosis": found}, AugmentConfig(), out(tmp_path / "a"))
    model = load_model(tmp_path / "a")
    assert isinstance(model, FilledEngineModel) and model.effects[0]["d_ln_e"] == pytest.approx(0.3)
    run({"model": Input(tmp_path / "a")}, AugmentConfig(remove=True), out(tmp_path / "b"))
    assert files(tmp_path / "b") == files(engine.path)
    run({"model": learned, "engine": engine, "diagnosis": found}, AugmentConfig(), out(tmp_path / "c"))
    model = load_model(tmp_path / "c")
    assert isinstance(model, AugmentedModel) and model.effects[0]["d_ln_e"] == pytest.approx(0.3)


def test_a_users_effect_travels_with_the_model(engine, tmp_path):
    mine = tmp_path / "mine.py"
    mine.write_text(
        "from plop.physics.effects.effect import Effect, Parameter\n\n\nclass Mine(Effect):\n    name = 'mine'\n"
        "    help = law = source = 'test'\n    amplitudes = (Parameter('a', '-', 0.0, 1.0, step=0.1),)\n\n"
        "    def before(self, body, dt):\n        body.v[:, 0] += self['a'] * dt\n"
    )
    run({"model": engine, "effect_file": Input(mine)}, AugmentConfig("mine", ("a=0.5",)), out(tmp_path / "a"))
    mine.unlink()
    assert load_model(tmp_path / "a").effects[0]["a"] == 0.5


@pytest.mark.parametrize(
    "value, where",
    [
        (("viscosity_pa_s=1e9",), "viscosity.viscosity_pa_s"),
        (("viscosity_pa_s=-1",), "viscosity.viscosity_pa_s"),
        (("viscosity_pa_s=nan",), "viscosity.viscosity_pa_s"),
        (("viscosity=3",), "viscosity.viscosity"),
        (("viscosity_pa_s=much",), "--value"),
        (("viscosity_pa_s",), "--value"),
        (("=1",), "--value"),
        (("viscosity_pa_s=0",), "viscosity"),
    ],
)
def test_values_that_cannot_be_are_refused(engine, tmp_path, value, where):
    with pytest.raises(PlopError) as caught:
        run({"model": engine}, AugmentConfig("viscosity", value), out(tmp_path / "a"))
    assert caught.value.where == where and caught.value.fix
    assert not (tmp_path / "a" / "model.json").exists()


def test_a_wrong_value_is_told_before_a_diagnosis_is_made():
    with pytest.raises(PlopError, match="out of range"):
        STAGE.check(AugmentConfig("viscosity", ("viscosity_pa_s=1e9",)), {})
    with pytest.raises(PlopError, match="no such effect") as caught:
        STAGE.check(AugmentConfig("viscocity"), {})
    assert caught.value.fix == "Did you mean viscosity?"


def test_nothing_to_add_is_said(engine, tmp_path):
    with pytest.raises(PlopError, match="no effect to add"):
        run({"model": engine}, AugmentConfig(), out(tmp_path / "a"))
    with pytest.raises(PlopError, match="no effect to add"):  # nothing detectable
        run({"model": engine, "diagnosis": diagnosis(tmp_path / "d", ())}, AugmentConfig(), out(tmp_path / "b"))
    with pytest.raises(PlopError, match="no effect to add"):  # not among what was fitted
        run({"model": engine, "diagnosis": diagnosis(tmp_path / "d")}, AugmentConfig("tilt"), out(tmp_path / "c"))


def test_an_unknown_effect_gets_a_suggestion(engine, tmp_path):
    with pytest.raises(PlopError) as caught:
        run({"model": engine}, AugmentConfig("viscosty", ("a=1",)), out(tmp_path / "a"))
    assert caught.value.fix == "Did you mean viscosity?"


def test_a_learned_model_needs_an_engine_beside_it(learned, tmp_path):
    with pytest.raises(PlopError, match="needs the engine"):
        run({"model": learned}, AugmentConfig("tilt", ("gx_m_s2=1",)), out(tmp_path / "a"))


def test_only_what_was_added_can_be_removed(engine, tmp_path):
    with pytest.raises(PlopError, match="no added effect"):
        run({"model": engine}, AugmentConfig(remove=True), out(tmp_path / "a"))


def test_what_the_diagnosis_does_not_name_is_added_with_a_warning(engine, tmp_path):
    found = diagnosis(tmp_path / "d", ("swelling",), gain=-0.13, p=1.0)
    summary = run({"model": engine, "diagnosis": found}, AugmentConfig("viscosity"), out(tmp_path / "a"))
    assert summary.warnings == [
        "The diagnosis does not name viscosity (-13 % of the held-out error, p = 1): its verdict is EFFECT swelling."
    ]
    named = {"model": engine, "diagnosis": diagnosis(tmp_path / "e")}
    assert run(named, AugmentConfig(), out(tmp_path / "b")).warnings == []


def test_a_diagnosis_of_another_model_is_refused(engine, tmp_path):
    def manifest(stage: str, files: dict[str, str], model: str = "") -> Manifest:
        judged = {"model": {"stage": "identify", "fingerprint": "0" * 16, "content": model}}
        return Manifest(stage, "f" * 16, 1, {}, judged, files)

    mine = manifest("identify", {"model.json": "a" * 64})
    content = content_digest(content_files(mine))
    found = diagnosis(tmp_path / "d")
    model = Input(engine.path, mine)
    run(
        {"model": model, "diagnosis": Input(found.path, manifest("diagnose", {}, content))},
        AugmentConfig(),
        out(tmp_path / "a"),
    )
    with pytest.raises(PlopError, match="another model") as caught:
        run(
            {"model": model, "diagnosis": Input(found.path, manifest("diagnose", {}, "other"))},
            AugmentConfig(),
            out(tmp_path / "b"),
        )
    assert "--fit" in caught.value.fix and not (tmp_path / "b" / "model.json").exists()


def test_a_diagnosis_of_another_layout_is_refused_with_what_to_do(engine, tmp_path):
    found = diagnosis(tmp_path / "d")
    facts = json.loads((found.path / "diagnosis.json").read_text())
    (found.path / "diagnosis.json").write_text(json.dumps(facts | {"schema": 1}))
    with pytest.raises(SchemaError, match="another version") as caught:
        run({"model": engine, "diagnosis": found}, AugmentConfig(), out(tmp_path / "a"))
    assert "plop diagnose" in caught.value.fix and not (tmp_path / "a" / "model.json").exists()
