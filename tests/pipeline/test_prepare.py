"""What a command needs is found, or it is asked for by name; nothing is guessed between two."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from plop.artifacts.lineage import LEFT_OUT
from plop.artifacts.manifest import Manifest
from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.pipeline.execute import execute
from plop.pipeline.preparation import Preparation, takes_model_instead, wants_preparation
from plop.pipeline.registry import stage_ref
from plop.pipeline.report_inputs import report_inputs
from plop.pipeline.stage import Inputs, InputSpec, Stage
from plop.recordings.set import RecordingSet
from plop_cli.app import main
from tests.pipeline import fake_stages as fake

REPORT = stage_ref("report").load()
DIAGNOSE = stage_ref("diagnose").load()


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path)


def stage(name: str, **inputs: tuple[str, ...]) -> Stage:
    """A stage that only says what it was made from."""
    specs = {key: InputSpec(stages, "") for key, stages in inputs.items()}
    return Stage(name, 1, "", fake.PiecesConfig, specs, fake.FIT.run)


def made(store: Store, name: str, seed: int = 0, **inputs: Artifact) -> Artifact:
    made_of = stage(name, **{key: (a.key[0],) for key, a in inputs.items()})
    addresses = {key: a.address for key, a in inputs.items()}
    return execute(made_of, store=store, config=fake.PiecesConfig(seed=seed), inputs=addresses).artifact


def recordings(store: Store, name: str, **settings: int) -> Artifact:
    raw = fake.raw_folder(store.workspace / name, f"{name} ")
    return execute(fake.INGEST, store=store, config=fake.PiecesConfig(**settings), inputs={"raw": raw}).artifact


def preparation(store: Store) -> Preparation:
    return Preparation(store)


def test_an_empty_workspace_says_what_is_missing(store):
    with pytest.raises(PlopError) as caught:
        preparation(store).inputs(DIAGNOSE, {}, None)
    assert "in this workspace" in caught.value.found and caught.value.expected.startswith("--")


def test_several_recordings_and_none_named_is_a_question(store):
    recordings(store, "blocks")
    recordings(store, "blocks", pieces=5)
    base = made(store, "identify", recordings=store.artifacts("ingest")[0])
    with pytest.raises(PlopError, match="Which recordings") as caught:
        preparation(store).inputs(DIAGNOSE, {"model": base.address}, None)
    assert caught.value.expected == "--recordings NAME" and caught.value.found.count("ingest@") == 2


def test_a_stage_refuses_what_is_there_before_anything_is_made(store):
    def refuse(inputs: Inputs, config: fake.PiecesConfig) -> None:
        seen.append((sorted(inputs), config))
        raise PlopError("Not these.")

    seen: list[tuple] = []
    specs = {**DIAGNOSE.inputs, "recordings": InputSpec(("ingest",), "")}
    asked = replace(DIAGNOSE, inputs=specs, config=fake.PiecesConfig, check_inputs=refuse)
    blocks = recordings(store, "blocks")
    base = made(store, "identify", recordings=blocks)
    named = {"model": base.address, "recordings": blocks.address, "effect_file": "mine.py"}
    with pytest.raises(PlopError, match="Not these"):
        preparation(store).inputs(asked, named, None, fake.PiecesConfig(seed=3))
    assert seen == [(["model", "recordings"], fake.PiecesConfig(seed=3))]
    assert store.artifacts("fuse", "fit-init") == []


def test_what_cannot_be_an_input_is_told_before_anything_is_made(store):
    blocks = recordings(store, "blocks")
    base = made(store, "identify", recordings=blocks)
    for command, given in (
        ("identify", {"recordings": base.address}),
        ("diagnose", {"model": blocks.address, "recordings": blocks.address}),
    ):
        with pytest.raises(PlopError, match=f"cannot be the (model|recordings) of `{command}`"):
            preparation(store).inputs(stage_ref(command).load(), given, None)
    with pytest.raises(PlopError, match="What shall be reported"):
        report_inputs(preparation(store), REPORT, {"models": " ", "recordings": blocks.address}, REPORT.config())
    assert store.artifacts("fuse", "fit-init") == []


def test_a_model_that_is_reported_twice_is_refused_before_anything_is_made(store):
    blocks = recordings(store, "blocks")
    base = made(store, "identify", recordings=blocks)
    with pytest.raises(PlopError, match="named twice"):
        twice = {"models": f"{base.address}, {base.address}", "recordings": blocks.address}
        report_inputs(preparation(store), REPORT, twice, REPORT.config())
    assert store.artifacts("fuse", "fit-init", "compare") == []


def test_a_report_refuses_what_recordings_tell_before_models_are_compared(store):
    def refuse(inputs: Inputs, config: object) -> None:
        raise PlopError(f"No such camera in {inputs['recordings'].path.name}.")

    blocks = recordings(store, "blocks")
    base = made(store, "identify", recordings=blocks)
    with pytest.raises(PlopError, match="No such camera in"):
        report_inputs(
            preparation(store),
            replace(REPORT, check_inputs=refuse),
            {"models": base.address, "recordings": blocks.address},
            REPORT.config(),
        )
    assert store.artifacts("fuse", "fit-init", "compare") == []


def test_the_source_of_a_model_is_what_its_base_was_made_from(store):
    plain, mystery = recordings(store, "blocks"), recordings(store, "blocks", pieces=5)
    base = made(store, "identify", recordings=plain)
    diagnosis = made(store, "diagnose", recordings=mystery, model=base)
    once = made(store, "augment", model=base, diagnosis=diagnosis)
    twice = made(store, "augment", 1, model=once, diagnosis=diagnosis)
    for model in (base, once, twice):
        found = preparation(store).source_of(model)
        assert found is not None and found.key == plain.key


def test_recordings_that_the_model_was_made_from_are_no_reference_of_themselves(store):
    plain, mystery = recordings(store, "blocks"), recordings(store, "blocks", pieces=5)
    base = made(store, "identify", recordings=plain)
    for asked, expected in ((plain, LEFT_OUT), (mystery, plain.address)):
        found: dict[str, str | Path] = {"recordings": asked.address}
        preparation(store)._reference(found, base)
        assert found["reference"] == expected


def test_tracks_are_made_from_the_fit_that_is_given_and_a_fit_is_that_of_the_given_tracks(store, monkeypatch):
    def noted(self, command, inputs, extra):
        asked[command] = dict(inputs)
        return made(store, command, recordings=plain)

    asked: dict[str, dict] = {}
    monkeypatch.setattr(Preparation, "_made", noted)
    plain = recordings(store, "blocks")
    mine = made(store, "fit-init", 7, recordings=plain)
    given = {"recordings": plain.address, "init": mine.address}
    identify = replace(stage_ref("identify").load(), check_inputs=None)  # these recordings have no episodes
    assert preparation(store).inputs(identify, given, None)["init"] == mine.address
    assert asked["filter"]["init"] == mine.address and "fit-init" not in asked
    tracks = made(store, "filter", 7, recordings=plain, init=mine)
    found = preparation(store).inputs(identify, {"recordings": plain.address, "tracks": tracks.address}, None)
    assert store.find(str(found["init"])).key == mine.key and "fit-init" not in asked


@pytest.mark.parametrize(
    ("test", "written", "chosen"),
    [(["c"], "", {}), ([], "", {"split": "all"}), ([], '[rollout]\nsplit = "train"\n', {})],
)
def test_recordings_without_test_episodes_are_rolled_out_whole(store, test, written, chosen):
    """Unless the workspace says which; else neither `eval` nor `report` could be made of them."""
    RecordingSet(store.workspace, "blocks", ["a", "b"], test).save()
    (store.workspace / "plop.toml").write_text(written)
    artifact = Artifact(store.workspace, Manifest("ingest", "f", 1, config={}, inputs={}))
    assert preparation(store)._split(artifact) == chosen


def test_which_commands_prepare():
    assert wants_preparation(DIAGNOSE, {})
    scores = replace(
        DIAGNOSE,
        inputs={"recordings": InputSpec(("ingest",), ""), "rollouts": InputSpec(("rollout",), "", along="recordings")},
    )
    assert takes_model_instead(scores) and not takes_model_instead(DIAGNOSE)
    assert wants_preparation(scores, {"model": "base"}) and not wants_preparation(scores, {"rollouts": "x"})
    assert not wants_preparation(stage_ref("fuse").load(), {})


def test_wrong_settings_are_told_before_anything_is_made_on_the_way(store, monkeypatch, capsys):
    def made_too_soon(*_: object) -> None:
        raise AssertionError("inputs were made for settings that cannot be used")

    monkeypatch.setattr(Preparation, "inputs", made_too_soon)
    monkeypatch.setattr("plop.pipeline.run.report_inputs", made_too_soon)
    monkeypatch.setattr("plop.pipeline.run.augment_inputs", made_too_soon)
    named = {
        "diagnose": ["--model", "m", "--recordings", "r"],
        "compare": ["--model", "m", "--recordings", "r"],
        "identify": ["--recordings", "r"],
        "report": ["--models", "m", "--recordings", "r"],
        "augment": ["--model", "m", "--fit", "r"],
    }
    for command, *words, told in (
        ("diagnose", "--effects", "tilf", "Did you mean tilt?"),
        ("diagnose", "--shams", "3", "49 or more"),
        ("compare", "--split", "tset", "train or test or all"),
        ("identify", "--fit", "poison", "mean poisson?"),
        ("report", "--frames", "-1", "2 or more"),
        ("augment", "--effect", "tilf", "Did you mean tilt?"),
    ):
        assert main([command, *named[command], "-w", str(store.workspace), *words]) == 1
        assert told in capsys.readouterr().err


def test_a_dry_run_names_what_would_be_made_on_the_way_and_makes_nothing(store, monkeypatch, capsys):
    plain, mystery = recordings(store, "blocks"), recordings(store, "blocks", pieces=5)
    base = made(store, "identify", recordings=plain)
    fit = made(store, "fit-init", recordings=plain)
    tracks = made(store, "filter", recordings=plain, init=fit)  # of other recordings than those that are compared
    before = {a.key for a in store.artifacts()}
    monkeypatch.setattr(Preparation, "check_inputs", lambda *_: None)  # these recordings have no episodes
    command = [
        "compare",
        "--model",
        base.address,
        "--recordings",
        mystery.address,
        "--dry-run",
        "-w",
        str(store.workspace),
    ]
    assert main([*command, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["would_run_first"] == {"init": "fit-init", "tracks": "filter"} and facts["address"] is None
    assert facts["inputs"] == {"recordings": mystery.address, "model": base.address}
    assert main(command) == 0
    told = capsys.readouterr().out
    assert fit.address not in told and "`plop filter` would run first" in told
    assert {a.key for a in store.artifacts()} == before
    monkeypatch.setattr(Preparation, "derived", lambda self, command, *more: fit if command == "fit-init" else tracks)
    assert main([*command, "--json"]) == 0  # all is there: the run itself is planned
    facts = json.loads(capsys.readouterr().out)
    assert facts["address"].startswith("compare@") and facts["inputs"]["init"] == fit.address


def test_the_only_model_being_of_a_newer_plop_is_the_reason_that_is_told(store):
    base = made(store, "identify", recordings=recordings(store, "blocks"))
    path = base.path / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": 99}))
    with pytest.raises(PlopError, match="newer plop"):
        preparation(store).inputs(DIAGNOSE, {}, None)
