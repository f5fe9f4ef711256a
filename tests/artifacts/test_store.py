"""The store adds artifacts whole or not at all, and finds them by address."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from plop.artifacts.manifest import Manifest, read_manifest
from plop.artifacts.store import Artifact, Store
from plop.artifacts.verify import obvious_damage, verify
from plop.errors import PlopError


def add(store: Store, stage: str, fingerprint: str, text: str = "content", environment: str = "one") -> Artifact:
    scratch = store.scratch(stage, fingerprint)
    (scratch / "folder").mkdir(exist_ok=True)
    (scratch / "folder" / "payload.txt").write_text(text)
    artifact = store.commit(scratch, Manifest(stage, fingerprint, 1, {}, {}, environment=environment))
    store.record(artifact, 1.0)
    return artifact


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path)


def test_committed_manifest_reads_back_equal(store: Store):
    artifact = add(store, "train", "3f9a1c0011223344")
    assert read_manifest(artifact.path) == artifact.manifest
    assert list(artifact.manifest.files) == ["folder/payload.txt"]


def test_traces_of_the_run_are_not_payload(store: Store):
    scratch = store.scratch("train", "aa")
    (scratch / ".done").mkdir()
    (scratch / ".done" / "episode").touch()
    (scratch / "half.h5.tmp").write_text("half")
    (scratch / "kept.txt").write_text("kept")
    artifact = store.commit(scratch, Manifest("train", "aa", 1, {}, {}))
    assert sorted(path.name for path in artifact.path.iterdir()) == ["kept.txt", "manifest.json"]


@pytest.mark.parametrize("address", ["train@3f9a", "train@latest", "base"])
def test_addresses(store: Store, address: str):
    add(store, "train", "77aa")
    artifact = add(store, "train", "3f9a1c0011223344")
    store.set_name("base", artifact)
    assert store.find(address).key == artifact.key


def test_latest_is_the_one_last_asked_for(store: Store):
    first = add(store, "train", "01")
    add(store, "train", "02")
    assert store.find("train@latest").key == ("train", "02")
    store.record(first, None)
    assert store.find("train@latest").key == first.key


@pytest.mark.parametrize("address", ["train@ff", "train@", "bsae", "rollout@latest", "../x@01"])
def test_unknown_address_is_a_clear_error(store: Store, address: str):
    store.set_name("base", add(store, "train", "01"))
    with pytest.raises(PlopError, match=r"There is no artifact"):
        store.find(address)


def test_the_latest_are_told_where_none_is_like_what_was_asked_for(store: Store):
    names = ["base", "block", "mystery", "plain", "quiet", "verdict", "zebra"]
    for number, name in enumerate(names):
        store.set_name(name, add(store, "train", f"{number:02d}"))
    with pytest.raises(PlopError) as caught:
        store.find("xxxxx")
    assert caught.value.found == "nothing; perhaps " + "; ".join(
        f"{name} = train@{number:02d}" for number, name in list(enumerate(names))[:0:-1]
    )


def test_ambiguous_prefix_lists_candidates(store: Store):
    add(store, "train", "0a1")
    add(store, "train", "0a2")
    with pytest.raises(PlopError, match="several") as caught:
        store.find("train@0a")
    assert "train@0a1" in str(caught.value.found)


@pytest.mark.parametrize("name", ["../escape", "a/b", "latest", "train@1", "", ".hidden"])
def test_names_cannot_leave_the_folder(store: Store, name: str):
    with pytest.raises(PlopError):
        store.set_name(name, add(store, "train", "01"))


def test_newer_schema_is_refused_but_blocks_nothing_else(store: Store):
    newer, fine = add(store, "train", "01"), add(store, "train", "02")
    facts = json.loads((newer.path / "manifest.json").read_text())
    (newer.path / "manifest.json").write_text(json.dumps(facts | {"schema": 99, "future": True}))
    with pytest.raises(PlopError, match="newer plop"):
        store.find("train@01")
    assert [a.key for a in store.artifacts()] == [fine.key]
    assert list(store.unreadable()) == [newer.path]


@pytest.mark.parametrize("text", ["", "{", '{"schema": 1}', "[]"])
def test_damaged_manifest_is_a_clear_error(store: Store, text: str):
    artifact = add(store, "train", "01")
    (artifact.path / "manifest.json").write_text(text)
    with pytest.raises(PlopError, match="manifest"):
        store.find("train@01")


def test_manifest_cannot_name_files_outside(store: Store):
    artifact = add(store, "train", "01")
    facts = json.loads((artifact.path / "manifest.json").read_text())
    facts["files"] = {"../../secret": "00"}
    (artifact.path / "manifest.json").write_text(json.dumps(facts))
    with pytest.raises(PlopError, match="outside"):
        store.find("train@01")


@pytest.mark.parametrize("damage", ["flip", "truncate", "remove"])
def test_damaged_payload_names_the_file(store: Store, damage: str):
    artifact = add(store, "train", "01", text="content")
    verify(artifact, store.cache)
    path = artifact.path / "folder" / "payload.txt"
    if damage == "remove":
        path.unlink()
    else:
        path.write_text("kontent" if damage == "flip" else "con")
    with pytest.raises(PlopError, match="damaged") as caught:
        verify(artifact, store.cache)
    assert str(caught.value.where) == str(path)


def test_killed_between_the_renames_gives_the_old_artifact_back(store: Store):
    artifact = add(store, "train", "01", text="old")
    artifact.path.rename(artifact.path.with_name(".old-01"))
    store.scratch("train", "01")
    assert (store.find("train@01").path / "folder" / "payload.txt").read_text() == "old"


def test_moved_workspace_still_works(store: Store, tmp_path: Path):
    store.set_name("base", add(store, "train", "01"))
    moved = tmp_path.with_name(tmp_path.name + "_moved")
    tmp_path.rename(moved)
    verify(Store(moved).find("base"), Store(moved).cache)


def test_what_makes_a_damaged_payload_again_is_the_command_that_made_it(store: Store):
    scratch = store.scratch("ingest", "aa")
    (scratch / "kept.txt").write_text("kept")
    artifact = store.commit(scratch, Manifest("ingest", "aa", 1, {}, {}, provenance={"command": "ingest mesh"}))
    assert obvious_damage(artifact) is None
    (artifact.path / "kept.txt").write_text("KEPT")  # of the same size: seen by reading only
    assert obvious_damage(artifact) is None
    (artifact.path / "kept.txt").unlink()
    damage = obvious_damage(artifact)
    assert damage is not None and "`plop ingest mesh` with --force" in str(damage.fix)


def test_damaged_journal_only_forgets_the_order(store: Store):
    add(store, "train", "01")
    with store.journal.path.open("a") as file:
        file.write('{"stage": "tra')
    assert [a.key for a in store.artifacts()] == [("train", "01")]


def spoil(artifact: Artifact, **facts: object) -> None:
    """Make a manifest one that only a newer plop reads."""
    path = artifact.path / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": 99} | facts))


def test_the_latest_that_cannot_be_used_says_why(store: Store):
    newer = add(store, "train", "01")
    spoil(newer)
    with pytest.raises(PlopError, match="newer plop") as caught:
        store.find("train@latest")
    assert str(newer.path) in str(caught.value.fix) and "--force" in str(caught.value.fix)


def test_one_that_was_passed_over_is_told(tmp_path: Path):
    told: list[str] = []
    store = Store(tmp_path, warn=told.append)
    old = add(store, "train", "01")
    fine = add(store, "train", "02")
    spoil(old)
    assert store.find("train@latest").key == fine.key and told == []
    later = add(store, "train", "03")
    spoil(later)
    assert store.find("train@latest").key == fine.key
    assert len(told) == 1 and str(later.path) in told[0] and "newer plop" in told[0]


@pytest.mark.parametrize("below", ["", "sub", "sub/deeper"])
def test_a_file_cannot_be_a_workspace(tmp_path: Path, below: str):
    (tmp_path / "file").write_text("")
    with pytest.raises(PlopError, match="there is a file at") as caught:
        Store(tmp_path / "file" / below)
    assert "--workspace" in str(caught.value.fix) and caught.value.where == str(tmp_path / "file")


def test_a_scratch_folder_goes_unless_it_holds_something(store: Store):
    scratch = store.scratch("train", "01")
    (scratch / ".checkpoints").mkdir()
    store.drop_empty(scratch)
    assert not scratch.exists()
    (store.scratch("train", "01") / "half.tmp").touch()
    store.drop_empty(scratch)
    assert scratch.exists()
