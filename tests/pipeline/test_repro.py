"""`plop repro`: what is stale is made again with the settings that it was made with; nothing else runs."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from plop.artifacts.lineage import parents
from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.pipeline.execute import execute
from plop.pipeline.registry import StageRef
from plop.pipeline.repro import Renewal
from plop.pipeline.stage import Recipe
from plop_cli.app import main
from tests.pipeline import fake_stages as fake

STAGES = {"ingest mesh": fake.INGEST, "calibrate": fake.CALIBRATE, "fuse": fake.FUSE, "fit-init": fake.FIT}


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    """Give a workspace in which stages do next to nothing: blocks -> ingest, named fuse with capitals -> fit-init."""
    current = dict(STAGES)
    monkeypatch.setattr(StageRef, "load", lambda ref: current[ref.command])
    monkeypatch.setattr("tests.pipeline.test_repro.current", current, raising=False)
    fake.raw_folder(tmp_path / "blocks")
    command("ingest", "mesh", str(tmp_path / "blocks"), "--pieces", "3", store=tmp_path)
    command("fuse", "--upper", "--name", "capitals", store=tmp_path)
    command("fit-init", store=tmp_path)
    return Store(tmp_path)


def command(*words: str, store: Path | Store) -> int:
    return main([*words, "-w", str(store if isinstance(store, Path) else store.workspace), "-q"])


def newer(command_: str, **change: object) -> None:
    current[command_] = replace(current[command_], version=current[command_].version + 1, **change)  # type: ignore[name-defined]  # noqa: F821


def planned(store: Store, *chosen: Artifact) -> list[str]:
    return [task.ref.command for task in Renewal(store).tasks(chosen).values()]


def test_what_is_current_stays(store, capsys):
    before = {a.key for a in store.artifacts()}
    assert planned(store) == []
    assert main(["repro", "-w", str(store.workspace)]) == 0
    assert "nothing is stale" in capsys.readouterr().out and {a.key for a in store.artifacts()} == before


def test_changed_raw_data_goes_through_with_the_same_settings(store, capsys):
    old = store.find("capitals")
    fake.raw_folder(store.workspace / "blocks", "changed ")
    assert planned(store) == ["ingest mesh", "fuse", "fit-init"]
    assert main(["repro", "--dry-run", "-w", str(store.workspace)]) == 0
    assert store.find("capitals").key == old.key and "plop fuse" in capsys.readouterr().out
    assert command("repro", store=store) == 0
    new = store.find("capitals")
    assert new.key != old.key and new.manifest.config == old.manifest.config == {"upper": True}
    assert (new.path / "sub" / "all.txt").read_text().startswith("CHANGED")
    assert len(list(store.find("ingest@latest").path.glob("piece_*"))) == 3
    assert parents(store.find("fit-init@latest"))["clouds"] == new.key
    assert planned(store) == [] and main(["status", "-w", str(store.workspace)]) == 0
    assert "stale" not in capsys.readouterr().out.replace("--stale", "")


def test_a_new_version_that_makes_the_same_leaves_what_follows(store):
    newer("fuse")
    fit = store.find("fit-init@latest")
    assert planned(store) == ["fuse", "fit-init"]
    assert command("repro", store=store) == 0
    assert len(store.artifacts("fuse")) == 2 and [a.key for a in store.artifacts("fit-init")] == [fit.key]
    assert planned(store) == []


def test_one_artifact_can_be_named(store):
    newer("ingest mesh"), newer("fuse"), newer("fit-init")
    assert planned(store, store.find("capitals")) == ["ingest mesh", "fuse"]
    assert command("repro", "ingest@latest", store=store) == 0
    assert [len(store.artifacts(stage)) for stage in ("ingest", "fuse", "fit-init")] == [2, 1, 1]
    assert main(["repro", "capital", "-w", str(store.workspace), "-q"]) == 1


def test_what_is_damaged_is_made_again(store):
    (store.find("capitals").path / "sub" / "all.txt").write_text("x")
    assert planned(store) == ["fuse"]
    assert command("repro", store=store) == 0
    assert (store.find("capitals").path / "sub" / "all.txt").read_text().startswith("RAW")


def test_an_input_that_is_gone_is_made_where_a_recipe_says_how(store, monkeypatch):
    clouds = replace(fake.FIT.inputs["clouds"], recipe=Recipe({"recordings": "recordings"}))
    current["fit-init"] = replace(fake.FIT, inputs={**fake.FIT.inputs, "clouds": clouds})  # type: ignore[name-defined]  # noqa: F821
    shutil.rmtree(store.find("capitals").path)
    tasks = Renewal(store).tasks()
    assert [task.ref.command for task in tasks.values()] == ["fit-init"]
    assert [one.ref.command for task in tasks.values() for one in task.before] == ["fuse"]
    assert command("repro", store=store) == 0
    assert store.find("fuse@latest").manifest.config == {"upper": False}, "by the workspace's settings"


def test_an_input_that_is_gone_for_good_is_told(store, capsys):
    shutil.rmtree(store.find("ingest@latest").path)
    assert main(["repro", "-w", str(store.workspace)]) == 1
    message = capsys.readouterr().err
    assert "its recordings is gone" in message and "expected: ingest@" in message


def test_raw_data_that_is_unplugged_is_needed_only_where_it_is_read_again(store, capsys):
    shutil.rmtree(store.workspace / "blocks")
    newer("fuse")
    assert command("repro", store=store) == 0
    newer("ingest mesh")
    assert main(["repro", "-w", str(store.workspace)]) == 1
    assert "no such file" in capsys.readouterr().err


def test_settings_of_another_version_are_told(store, capsys):
    path = store.find("capitals").path / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"config": {"shout": True}}))
    newer("fuse")
    assert main(["repro", "-w", str(store.workspace)]) == 1
    message = capsys.readouterr().err
    assert "not those of this version" in message and "plop fuse" in message


def forged(store: Store) -> Artifact:
    """Let the recordings come from what was made of them."""
    first, last = store.find("ingest@latest"), store.find("capitals")
    path = first.path / "manifest.json"
    facts = json.loads(path.read_text())
    facts["inputs"]["recordings"] = {"stage": last.key[0], "fingerprint": last.key[1], "content": last.content}
    path.write_text(json.dumps(facts))
    return first


@pytest.mark.parametrize("words", [["repro"], ["gc"], ["gc", "--delete"], ["run", "fit-init"], ["run", "fuse"]])
def test_a_circle_in_the_lineage_is_told(store, capsys, words):
    first = forged(store)
    before = {a.key for a in store.artifacts()}
    assert main([*words, "-w", str(store.workspace)]) == 1
    message = capsys.readouterr().err
    assert "descends from itself" in message and "manifest.json" in message and " <- " in message
    assert "Remove " in message and {a.key for a in store.artifacts()} == before and first.key in before


def test_status_shows_the_rest_of_a_circle(store, capsys):
    forged(store)
    assert main(["status", "-w", str(store.workspace)]) == 0
    seen = capsys.readouterr()
    assert "descends from itself" in seen.err and "fit-init@" in seen.out


def test_a_folder_that_is_no_workspace_is_told(tmp_path, capsys):
    for words in (["repro"], ["gc"]):
        assert main([*words, "-w", str(tmp_path / "nowhere")]) == 1
        assert "no such workspace" in capsys.readouterr().err


def test_a_stage_that_is_gone_is_told(store):
    old = store.find("capitals")
    (old.path / "sub" / "all.txt").write_text("x")
    path = old.path / "manifest.json"
    facts = json.loads(path.read_text())
    path.write_text(json.dumps(facts | {"provenance": facts["provenance"] | {"command": "melt"}}))
    with pytest.raises(PlopError, match="no longer exists"):
        Renewal(store).tasks()
    assert execute(fake.FUSE, store=store, config=fake.JoinConfig(upper=True), force=True).artifact.key == old.key
