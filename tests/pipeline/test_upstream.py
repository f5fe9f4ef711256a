"""What a command needs is found, planned, or asked for by name; nothing is guessed between two."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from plop.artifacts.lineage import parents
from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.pipeline.registry import StageRef, stage_ref
from plop.pipeline.stage import Inputs, InputSpec, Stage
from plop.pipeline.tasks import in_order
from plop.pipeline.upstream import Planner
from plop.recordings.set import RecordingSet
from plop_cli.app import main
from stages.augment.stage import AugmentConfig
from tests.pipeline import fake_stages as fake
from tests.pipeline.made_up import made, planned, recordings, told
from tests.support.diagnoses import diagnosis as made_diagnosis
from tests.support.diagnoses import ranked, verdict


@pytest.fixture(autouse=True)
def unchecked_stages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every stage take recordings and models which hold nothing."""
    load = StageRef.load
    monkeypatch.setattr(StageRef, "load", lambda ref: replace(load(ref), check_inputs=None))


def unchecked(command: str) -> Stage:
    return stage_ref(command).load()


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path)


def test_an_empty_workspace_says_what_is_missing(store):
    for command in ("eval", "diagnose", "train", "fuse", "report"):
        with pytest.raises(PlopError, match="this workspace has none") as caught:
            planned(store, unchecked(command))
        assert "plop ingest FOLDER" in str(caught.value.fix), command


def test_a_model_is_never_made_on_the_way(store):
    recordings(store, "blocks")
    for command in ("rollout", "compare", "eval"):
        with pytest.raises(PlopError, match="needs the input 'model'") as caught:
            planned(store, unchecked(command))
        assert "plop train" in str(caught.value.fix) and "plop identify" in str(caught.value.fix)


def test_several_recordings_and_none_named_is_a_question(store):
    recordings(store, "blocks")
    recordings(store, "blocks", pieces=5)
    base = made(store, "identify", recordings=store.artifacts("ingest")[0])
    with pytest.raises(PlopError, match="Which recordings") as caught:
        planned(store, unchecked("diagnose"), model=base)
    assert caught.value.expected == "--recordings NAME" and caught.value.found.count("ingest@") == 2


def test_what_is_missing_is_planned_in_order_and_shared(store):
    blocks = recordings(store, "blocks")
    base = made(store, "identify", recordings=blocks)
    task = planned(store, engineless("diagnose"), model=base, recordings=blocks)
    assert told(task) == {
        "recordings": blocks.address,
        "init": "fit-init",
        "tracks": "filter",
        "model": base.address,
        **dict.fromkeys(("reference", "reference_init", "reference_tracks", "effect_file")),
    }
    assert [one.ref.command for one in in_order(task.before)] == ["fuse", "fit-init", "filter"]


def test_the_stages_of_the_chain_make_what_they_lack(store):
    blocks = recordings(store, "blocks")
    assert told(planned(store, unchecked("train"))) == {
        "recordings": blocks.address,
        "init": "fit-init",
        "engine": None,
    }
    fit = made(store, "fit-init", recordings=blocks)
    assert told(planned(store, unchecked("train")))["init"] == fit.address, "what is there is taken, however made"
    base = made(store, "train", recordings=blocks, init=fit)
    assert told(planned(store, unchecked("rollout"))) == {
        "recordings": blocks.address,
        "init": fit.address,
        "model": base.address,
        "members": None,
        "measured": None,
    }
    other = made(store, "train", 1, recordings=blocks, init=fit)
    banded = planned(store, unchecked("rollout"), model=base, members=other.address)
    assert told(banded)["members"] == [other.address] and told(banded)["measured"] == "filter"


def test_a_stage_refuses_what_is_there_before_anything_is_planned_from_it(store):
    def refuse(inputs: Inputs, config: fake.PiecesConfig) -> None:
        seen.append((sorted(inputs), config))
        raise PlopError("Not these.")

    seen: list[tuple] = []
    asked = replace(unchecked("diagnose"), config=fake.PiecesConfig, check_inputs=refuse)
    blocks = recordings(store, "blocks")
    base = made(store, "identify", recordings=blocks)
    named = {"model": base, "recordings": blocks, "effect_file": "mine.py"}
    with pytest.raises(PlopError, match="Not these"):
        planned(store, asked, fake.PiecesConfig(seed=3), **named)
    assert seen == [(["effect_file", "model", "recordings"], fake.PiecesConfig(seed=3))]


@pytest.mark.parametrize(("command", "name"), [("identify", "recordings"), ("diagnose", "model")])
def test_what_cannot_be_an_input_is_told(store, command, name):
    blocks = recordings(store, "blocks")
    base = made(store, "identify", recordings=blocks)
    given = {"recordings": blocks, name: base if name == "recordings" else blocks}
    with pytest.raises(PlopError, match=f"cannot be the {name} of `{command}`"):
        planned(store, unchecked(command), **given)


def test_a_report_compares_and_scores_each_model(store):
    RecordingSet(recordings(store, "blocks").path, "blocks", ["a", "b"], ["b"]).save()
    (blocks,) = store.artifacts("ingest")
    base, more = made(store, "identify", recordings=blocks), made(store, "identify", 1, recordings=blocks)
    task = planned(store, unchecked("report"), models=f"{base.address}, {more.address}", recordings=blocks)
    facts = told(task)
    assert facts["models"] == [base.address, more.address] and facts["diagnoses"] is None
    assert facts["comparisons"] == ["compare"] * 2 and facts["evals"] == ["eval"] * 2
    compared = [one.inputs["model"] for one in in_order(task.before) if one.ref.command == "compare"]
    assert compared == [base, more]
    with pytest.raises(PlopError, match="named twice"):
        planned(store, unchecked("report"), models=f"{base.address}, {base.address}", recordings=blocks)
    with pytest.raises(PlopError, match="needs the input 'models'"):
        planned(store, unchecked("report"), recordings=blocks)


def test_a_model_leads_to_the_recordings_that_its_base_was_made_from(store):
    plain, mystery = recordings(store, "blocks"), recordings(store, "blocks", pieces=5)
    base = made(store, "identify", recordings=plain)
    diagnosis = made(store, "diagnose", recordings=mystery, model=base)
    once = made(store, "augment", model=base, diagnosis=diagnosis)
    twice = made(store, "augment", 1, model=once, diagnosis=diagnosis)
    for model in (base, once, twice):
        facts = told(planned(store, engineless("diagnose"), model=model, recordings=mystery))
        assert facts["reference"] == plain.address and facts["reference_tracks"] == "filter"
        same = told(planned(store, engineless("diagnose"), model=model, recordings=plain))
        assert same["reference"] is None and same["reference_init"] is None, "no reference of themselves"


def engineless(command: str) -> Stage:
    """A stage whose engine is nothing that is made: made-up models hold none."""
    stage = unchecked(command)
    return replace(stage, inputs={name: spec for name, spec in stage.inputs.items() if name != "engine"})


def test_a_learned_model_gets_an_engine_of_its_own_recordings(store):
    plain, mystery = recordings(store, "blocks"), recordings(store, "blocks", pieces=5)
    learned, engine = made(store, "train", recordings=plain), made(store, "identify", 7, recordings=plain)
    (learned.path / "model.json").write_text('{"schema": 1, "kind": "plop"}')
    task = planned(store, unchecked("diagnose"), model=learned, recordings=mystery)
    (fitted,) = [one for one in in_order(task.before) if one.ref.command == "identify"]
    assert task.inputs["engine"] is fitted and fitted.inputs["recordings"] == plain
    given = told(planned(store, unchecked("diagnose"), model=learned, recordings=mystery, engine=engine))
    assert given["engine"] == engine.address


def test_tracks_are_made_from_the_fit_that_is_given_and_a_fit_is_that_of_the_given_tracks(store):
    plain = recordings(store, "blocks")
    mine = made(store, "fit-init", 7, recordings=plain)
    task = planned(store, unchecked("identify"), recordings=plain, init=mine)
    (tracks,) = task.before
    assert tracks.ref.command == "filter" and tracks.inputs["init"] == mine
    assert tracks.inputs["model"] is None, "tracks on the way follow no model"
    followed = made(store, "filter", 7, recordings=plain, init=mine)
    assert told(planned(store, unchecked("identify"), tracks=followed)) == {
        "recordings": plain.address,
        "init": mine.address,
        "tracks": followed.address,
    }


def test_scores_are_of_the_latest_rollouts_unless_a_model_is_named(store):
    plain, mystery = recordings(store, "blocks"), recordings(store, "blocks", pieces=5)
    RecordingSet(mystery.path, "blocks", ["a", "b"], ["b"]).save()
    fit = made(store, "fit-init", recordings=plain)
    base = made(store, "train", recordings=plain, init=fit)
    rollouts = made(store, "rollout", recordings=plain, init=fit, model=base)
    found = told(planned(store, unchecked("eval")))
    others = {"engine": None, "tracks": None, "measured": None}
    assert found == {"recordings": plain.address, "init": fit.address, "rollouts": rollouts.address, **others}
    named = planned(store, unchecked("eval"), model=base, recordings=mystery)
    assert told(named) == {"recordings": mystery.address, "init": "fit-init", "rollouts": "rollout", **others}


@pytest.mark.parametrize(
    ("test", "written", "chosen"), [(["b"], "", "test"), ([], "", "all"), ([], '[rollout]\nsplit = "train"\n', "train")]
)
def test_recordings_without_test_episodes_are_rolled_out_whole(store, test, written, chosen):
    """Unless the workspace says which; else neither `eval` nor `report` could be made of them."""
    blocks = recordings(store, "blocks")
    RecordingSet(blocks.path, "blocks", ["a", "b"], test).save()
    (store.workspace / "plop.toml").write_text(written)
    base = made(store, "train", recordings=blocks)
    task = planned(store, unchecked("eval"), model=base, recordings=blocks)
    (rollout,) = [one for one in task.before if one.ref.command == "rollout"]
    assert rollout.config.split == chosen


def test_cameras_that_a_diagnosis_leaves_out_are_left_out_of_its_tracks(store):
    (store.workspace / "plop.toml").write_text('[filter]\nexclude = ["other"]\n')
    blocks = recordings(store, "blocks")
    base = made(store, "identify", recordings=blocks)
    config = replace(stage_ref("diagnose").load().config(), exclude=("top",))
    task = planned(store, engineless("diagnose"), config, model=base, recordings=blocks)
    (tracks,) = [one for one in task.before if one.ref.command == "filter"]
    assert list(tracks.config.exclude) == ["top"]


def fitted(store: Store, model: Artifact, of: Artifact, effects: list[str], seed: int = 0) -> Artifact:
    artifact = made(store, "diagnose", seed, recordings=of, model=model)
    made_diagnosis(verdict("NOTHING DETECTABLE"), *map(ranked, effects)).write(artifact.path)
    return artifact


def diagnosis(store: Store, config: AugmentConfig, **named: Artifact | str) -> object:
    return told(planned(store, engineless("augment"), config, **named))["diagnosis"]


def test_an_effect_is_that_of_the_latest_diagnosis_of_the_model_and_the_recordings_that_has_fitted_it(store):
    plain, mystery, other = (recordings(store, "blocks", pieces=n) for n in (4, 5, 6))
    base, rival = made(store, "identify", recordings=plain), made(store, "train", recordings=plain, init=plain)
    wide = fitted(store, base, mystery, ["viscosity", "tilt"])
    narrow = fitted(store, base, mystery, ["tilt"], seed=1)
    elsewhere = fitted(store, base, other, ["viscosity"])
    fitted(store, rival, mystery, ["viscosity"])
    viscosity = AugmentConfig(effect="viscosity")
    assert diagnosis(store, viscosity, model=base, fit=mystery) == wide.address
    assert diagnosis(store, AugmentConfig(), model=base, fit=mystery) == narrow.address
    assert diagnosis(store, viscosity, model=base) == elsewhere.address
    values = AugmentConfig(effect="viscosity", value=("viscosity_pa_s=1",))
    for config in (values, AugmentConfig(remove=True)):
        assert diagnosis(store, config, model=base) is None, "given values and taking an effect out need none"
    assert diagnosis(store, values, model=base, fit=mystery) == wide.address


def test_what_has_not_been_fitted_is_diagnosed_first(store, monkeypatch):
    monkeypatch.setattr("stages.diagnose.stage.STAGE", engineless("diagnose"))
    plain, mystery = recordings(store, "blocks"), recordings(store, "blocks", pieces=5)
    base = made(store, "identify", recordings=plain)
    fitted(store, base, mystery, ["tilt"])
    config = AugmentConfig(effect="viscosity")
    assert diagnosis(store, config, model=base) is None, "of no recordings"
    task = planned(store, engineless("augment"), config, model=base, fit=mystery, effect_file="mine.py")
    (first,) = task.before
    assert first.ref.command == "diagnose" and first.config.effects == ("viscosity",)
    assert told(first)["recordings"] == mystery.address and first.inputs["effect_file"] == Path("mine.py")


def test_a_diagnosis_and_recordings_at_once_are_refused(store, capsys):
    named = ["--model", "m", "--fit", "mystery", "--diagnosis", "verdict"]
    assert main(["augment", *named, "-w", str(store.workspace)]) == 1
    assert "Both --fit and --diagnosis" in capsys.readouterr().err


def test_a_report_tells_the_diagnoses_of_its_models_and_recordings(store):
    plain, mystery = recordings(store, "blocks"), recordings(store, "blocks", pieces=5)
    RecordingSet(mystery.path, "blocks", ["a", "b"], ["b"]).save()
    base = made(store, "identify", recordings=plain)
    wanted = fitted(store, base, mystery, ["tilt"])
    fitted(store, base, plain, ["tilt"])
    fitted(store, made(store, "identify", 1, recordings=plain), mystery, ["tilt"])
    facts = told(planned(store, unchecked("report"), models=base, recordings=mystery))
    assert facts["diagnoses"] == [wanted.address]
    assert parents(wanted)["recordings"] == mystery.key


def test_wrong_settings_are_told_before_anything_is_looked_for(store, monkeypatch, capsys):
    def too_soon(*_: object, **__: object) -> None:
        raise AssertionError("inputs were looked for with settings that cannot be used")

    monkeypatch.setattr(Planner, "task", too_soon)
    named = {
        "diagnose": ["--model", "m", "--recordings", "r"],
        "compare": ["--model", "m", "--recordings", "r"],
        "identify": ["--recordings", "r"],
        "report": ["--models", "m", "--recordings", "r"],
        "augment": ["--model", "m", "--fit", "r"],
    }
    for command, *words, message in (
        ("diagnose", "--effects", "tilf", "Did you mean tilt?"),
        ("diagnose", "--split", "tset", "train or test or all"),
        ("compare", "--split", "tset", "train or test or all"),
        ("identify", "--fit", "poison", "mean poisson?"),
        ("report", "--frames", "-1", "2 or more"),
        ("augment", "--effect", "tilf", "Did you mean tilt?"),
    ):
        assert main([command, *named[command], "-w", str(store.workspace), *words]) == 1
        assert message in capsys.readouterr().err


def test_a_dry_run_names_what_would_be_made_on_the_way_and_makes_nothing(store, monkeypatch, capsys):
    plain, mystery = recordings(store, "blocks"), recordings(store, "blocks", pieces=5)
    base = made(store, "identify", recordings=plain)
    fit = made(store, "fit-init", recordings=plain)
    made(store, "filter", recordings=plain, init=fit)  # of other recordings than those that are compared
    before = {a.key for a in store.artifacts()}
    command = ["run", "compare", "--model", base.address, "--recordings", mystery.address, "--dry-run"]
    command += ["-w", str(store.workspace)]
    assert main([*command, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["would_run_first"] == ["fuse", "fit-init", "filter"] and facts["address"] is None
    assert facts["inputs"]["recordings"] == mystery.address and facts["inputs"]["model"] == base.address
    assert main(command) == 0
    shown = capsys.readouterr().out
    assert fit.address not in shown and "plop filter" in shown and "would run" in shown
    assert {a.key for a in store.artifacts()} == before
    tracks = made(store, "filter", recordings=mystery, init=made(store, "fit-init", recordings=mystery))
    assert main([*command, "--tracks", tracks.address, "--json"]) == 0  # all is there: the run itself is planned
    facts = json.loads(capsys.readouterr().out)
    assert facts["address"].startswith("compare@") and facts["would_run_first"] == []


def test_the_only_model_being_of_a_newer_plop_is_the_reason_that_is_told(store):
    base = made(store, "identify", recordings=recordings(store, "blocks"))
    path = base.path / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": 99}))
    with pytest.raises(PlopError, match="newer plop"):
        planned(store, unchecked("diagnose"))


@dataclass(frozen=True)
class NoConfig:
    """No settings."""


def test_an_input_that_needs_itself_is_a_mistake_of_the_declaration(store):
    from plop.pipeline.stage import Choice, Recipe

    recipe = {"a": Recipe({"recordings": "b"}), "b": Recipe({"recordings": "a"})}
    specs = {name: InputSpec(("fuse",), "", choice=Choice.MADE, recipe=one) for name, one in recipe.items()}
    with pytest.raises(ValueError, match="cycle: a, b"):
        planned(store, Stage("odd", 1, "", NoConfig, specs, fake.FIT.run))
