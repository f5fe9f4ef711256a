"""One stage: inputs are found, equal runs are skipped, a failure harms nothing."""

from __future__ import annotations

import errno
import json
from dataclasses import replace
from pathlib import Path

import pytest

from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.pipeline.execute import Outcome, execute, plan
from plop.pipeline.stage import Choice, Stage, Summary
from plop_cli.status import unfinished
from tests.pipeline import fake_stages as fake


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path)


def ingest(store: Store, name: str = "blocks", **settings: int) -> Artifact:
    raw = fake.raw_folder(store.workspace / name, f"{name} ")
    return execute(fake.INGEST, store=store, config=fake.PiecesConfig(**settings), inputs={"raw": raw}).artifact


def run(store: Store, stage: Stage, **options: object) -> Outcome:
    return execute(stage, store=store, **options)  # type: ignore[arg-type]


def sources(outcome: Outcome) -> dict[str, str]:
    return {name: facts["fingerprint"] for name, facts in outcome.artifact.manifest.inputs.items()}


def test_second_run_is_skipped_and_force_gives_the_same(store: Store):
    ingest(store)
    first = run(store, fake.CALIBRATE)
    again, forced = run(store, fake.CALIBRATE), run(store, fake.CALIBRATE, force=True)
    assert (first.skipped, again.skipped, forced.skipped) == (False, True, False)
    assert first.artifact.manifest.files == forced.artifact.manifest.files
    assert first.artifact.key == forced.artifact.key


def test_manifest_tells_how_it_was_made(store: Store):
    manifest = ingest(store, pieces=2).manifest
    assert manifest.config == {"pieces": 2, "pause_s": 0.0, "seed": 0}
    assert manifest.inputs["raw"]["name"] == "blocks"
    assert manifest.provenance["raw_paths"] == {"raw": "blocks"}
    assert manifest.environment == "blocks"
    assert manifest.summary["figures"]["pieces"] == 2


def test_most_advanced_recordings_of_the_latest_line_are_taken(store: Store):
    first = ingest(store)
    calibrated = run(store, fake.CALIBRATE).artifact
    assert sources(run(store, fake.FIT)) == {"recordings": calibrated.key[1]}
    fuse = run(store, fake.FUSE, inputs={"recordings": "@".join(first.key)}).artifact
    assert sources(run(store, fake.FIT)) == {"recordings": calibrated.key[1], "clouds": fuse.key[1]}
    second = ingest(store, pieces=5)
    assert sources(run(store, fake.FIT)) == {"recordings": second.key[1]}


def test_inputs_come_from_one_line_of_descent(store: Store):
    ingest(store)
    calibrated = run(store, fake.CALIBRATE).artifact
    fit = run(store, fake.FIT).artifact
    ingest(store, pieces=5)  # more recent, but not what the fit was made of
    assert sources(run(store, fake.TRAIN)) == {"recordings": calibrated.key[1], "init": fit.key[1]}


def test_optional_input_can_be_left_out(store: Store):
    ingest(store)
    run(store, fake.FUSE)
    assert set(sources(run(store, fake.FIT))) == {"recordings", "clouds"}
    assert set(sources(run(store, fake.FIT, inputs={"clouds": "none"}))) == {"recordings"}


def test_an_input_that_only_the_user_names_is_not_guessed(store: Store):
    ingest(store)
    fuse = run(store, fake.FUSE).artifact
    spec = replace(fake.FIT.inputs["clouds"], choice=Choice.NAMED)
    fit = replace(fake.FIT, inputs={**fake.FIT.inputs, "clouds": spec})
    assert set(sources(run(store, fit))) == {"recordings"}
    assert set(sources(run(store, fit, inputs={"clouds": fuse.address}))) == {"recordings", "clouds"}


def test_several_environments_are_never_guessed(store: Store):
    one, two = ingest(store, "blocks"), ingest(store, "rolls")
    with pytest.raises(PlopError, match="Several environments") as caught:
        run(store, fake.CALIBRATE)
    assert one.address in str(caught.value.found)
    assert two.address in str(caught.value.found)
    chosen = run(store, fake.CALIBRATE, environment="blocks")
    assert sources(chosen) == {"recordings": one.key[1]}
    assert chosen.artifact.manifest.environment == "blocks"


def test_input_of_another_stage_or_nothing_is_a_clear_error(store: Store):
    with pytest.raises(PlopError, match="has none"):
        run(store, fake.CALIBRATE)
    ingest(store)
    calibrated = run(store, fake.CALIBRATE).artifact
    with pytest.raises(PlopError, match="cannot be the recordings"):
        run(store, fake.FUSE, inputs={"recordings": calibrated.address})
    with pytest.raises(PlopError, match="needs the input 'raw'"):
        run(store, fake.INGEST)
    with pytest.raises(PlopError, match="no such file"):
        run(store, fake.INGEST, inputs={"raw": store.workspace / "absent"})


def test_damaged_input_stops_the_stage(store: Store):
    artifact = ingest(store)
    (artifact.path / "piece_1.txt").write_text("x")
    with pytest.raises(PlopError, match="damaged") as caught:
        run(store, fake.CALIBRATE)
    assert "piece_1.txt" in str(caught.value.where)


def test_damaged_artifact_is_not_taken_for_done_and_force_mends_it(store: Store):
    artifact = ingest(store)
    (artifact.path / "piece_1.txt").write_text("x")
    with pytest.raises(PlopError, match="damaged"):
        ingest(store)
    raw = store.workspace / "blocks"
    mended = run(store, fake.INGEST, inputs={"raw": raw}, force=True).artifact
    assert mended.manifest.files == artifact.manifest.files


def test_full_disk_in_a_stage_harms_nothing(store: Store):
    artifact = ingest(store)
    with pytest.raises(PlopError, match="disk is full") as caught:
        run(store, fake.FULL_DISK)
    assert "Free some space" in str(caught.value.fix)
    assert [a.key for a in store.artifacts()] == [artifact.key]


@pytest.mark.parametrize("broken", ["write_manifest", "file_digest"])
def test_full_disk_while_committing_harms_nothing(store: Store, monkeypatch: pytest.MonkeyPatch, broken: str):
    ingest(store)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(PlopError, match="disk is full"):
        patch.setattr(f"plop.artifacts.commit.{broken}", full)
        run(store, fake.CALIBRATE)
    assert store.artifacts("calibrate") == []
    assert not run(store, fake.CALIBRATE).skipped


def test_full_disk_while_naming_what_is_there_is_told_alike(store: Store, monkeypatch: pytest.MonkeyPatch):
    raw = ingest(store).path.parents[2] / "blocks"

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(PlopError, match="disk is full"):
        patch.setattr("plop.artifacts.names.write_json", full)
        run(store, fake.INGEST, inputs={"raw": raw}, name="base")
    assert store.names() == {} and run(store, fake.INGEST, inputs={"raw": raw}, name="base").skipped


def test_a_name_that_moves_tells_whose_it_was(store: Store):
    first, raw = ingest(store), store.workspace / "blocks"
    assert run(store, fake.INGEST, inputs={"raw": raw}, name="base").name_from is None
    assert run(store, fake.INGEST, inputs={"raw": raw}, name="base").name_from is None, "it stays"
    again = run(store, fake.INGEST, config=fake.PiecesConfig(pieces=5), inputs={"raw": raw}, name="base")
    assert again.name_from == "@".join(first.key) and not again.skipped
    back = run(store, fake.INGEST, inputs={"raw": raw}, name="base")
    assert back.name_from == "@".join(again.artifact.key) and back.skipped


def test_finished_pieces_survive_a_failure(store: Store, monkeypatch: pytest.MonkeyPatch):
    raw = fake.raw_folder(store.workspace / "blocks")

    def stop(done: float, total: float, label: str = "", **figures: object) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(store, fake.INGEST, inputs={"raw": raw}, progress=stop)
    labels: list[str] = []
    scratch = next((store.root / "ingest").glob(".partial-*"))
    assert (scratch / "attempts.log.tmp").read_text().split() == ["piece_0", "piece_1"]
    run(store, fake.INGEST, inputs={"raw": raw}, progress=lambda done, total, label="", **figures: labels.append(label))
    assert labels == ["piece_2", "piece_3"]
    assert not scratch.exists()


def test_plan_runs_nothing(store: Store):
    raw = fake.raw_folder(store.workspace / "blocks")
    planned = plan(fake.INGEST, store=store, config=fake.PiecesConfig(), inputs={"raw": raw})
    assert planned.existing is None
    assert planned.last_seconds is None
    assert store.artifacts() == []
    run(store, fake.INGEST, inputs={"raw": raw})
    again = plan(fake.INGEST, store=store, config=fake.PiecesConfig(seed=1), inputs={"raw": raw})
    assert again.last_seconds is not None


def test_only_the_files_a_stage_reads_count(store: Store):
    import dataclasses

    raw = fake.raw_folder(store.workspace / "blocks")
    stage = dataclasses.replace(fake.INGEST, raw_files=lambda folder, config: [folder / "data.txt"])
    first = run(store, stage, inputs={"raw": raw})
    (raw / "other.txt").write_text("of another environment")
    assert run(store, stage, inputs={"raw": raw}).artifact.key == first.artifact.key


def of_newer_plop(artifact: Artifact) -> Artifact:
    path = artifact.path / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": 99}))
    return artifact


def test_the_only_input_being_of_a_newer_plop_is_the_reason_that_is_told(store: Store):
    artifact = of_newer_plop(ingest(store))
    for inputs in ({}, {"recordings": "ingest@latest"}):
        with pytest.raises(PlopError, match="newer plop") as caught:
            run(store, fake.CALIBRATE, inputs=inputs)
        assert str(artifact.path) in str(caught.value.where)


def test_an_input_of_the_same_recordings_of_a_newer_plop_is_the_reason_that_is_told(store: Store):
    ingest(store)
    run(store, fake.FIT)
    second = ingest(store, pieces=5)
    of_newer_plop(run(store, fake.FIT).artifact)
    with pytest.raises(PlopError, match="newer plop"):
        run(store, fake.TRAIN, inputs={"recordings": second.address})


def test_an_older_readable_input_is_taken_with_a_warning(tmp_path: Path):
    told: list[str] = []
    store = Store(tmp_path, warn=told.append)
    first = ingest(store)
    of_newer_plop(ingest(store, pieces=5))
    assert sources(run(store, fake.CALIBRATE)) == {"recordings": first.key[1]}
    assert len(told) == 1 and "newer plop" in told[0]
    of_newer_plop(run(store, fake.FUSE).artifact)
    assert set(sources(run(store, fake.FIT))) == {"recordings"}
    assert any("no artifact of fuse" in text for text in told), "an optional input that is left out is told, too"


def test_force_replaces_an_artifact_of_a_newer_plop(store: Store):
    artifact = of_newer_plop(ingest(store))
    raw = store.workspace / "blocks"
    with pytest.raises(PlopError, match="newer plop") as caught:
        run(store, fake.INGEST, inputs={"raw": raw})
    assert "--force" in str(caught.value.fix)
    assert run(store, fake.INGEST, inputs={"raw": raw}, force=True).artifact.key == artifact.key
    assert run(store, fake.INGEST, inputs={"raw": raw}).skipped


def test_a_run_that_is_refused_leaves_nothing_to_go_on_with(store: Store):
    def refuse(inputs: object, config: object, out: object) -> Summary:
        raise PlopError("A setting is out of range.")

    ingest(store)
    with pytest.raises(PlopError, match="out of range"):
        run(store, replace(fake.CALIBRATE, run=refuse))
    assert unfinished(store) == []
    with pytest.raises(PlopError, match="disk is full"):
        run(store, fake.FULL_DISK)
    assert [stage for stage, _ in unfinished(store)] == ["fuse"], "what wrote something goes on"
