"""What is stale, and why two artifacts differ."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from plop.artifacts.difference import first_difference
from plop.artifacts.stale import stale_reasons
from plop.artifacts.store import Artifact, Store
from plop.pipeline.execute import execute, raw_content
from plop.pipeline.stage import Stage
from tests.pipeline import fake_stages as fake


@pytest.fixture
def store(tmp_path: Path) -> Store:
    fake.raw_folder(tmp_path / "blocks")
    return Store(tmp_path)


def ingest(store: Store, **settings: int) -> Artifact:
    return execute(
        fake.INGEST, store=store, config=fake.PiecesConfig(**settings), inputs={"raw": store.workspace / "blocks"}
    ).artifact


def make(store: Store, stage: Stage, **settings: bool) -> Artifact:
    return execute(stage, store=store, config=fake.JoinConfig(**settings)).artifact


def reasons(store: Store, **versions: int) -> dict[tuple[str, str], str]:
    def raw_digest(artifact: Artifact, name: str, path: Path) -> str:
        return raw_content(store, fake.INGEST, path, fake.PiecesConfig())

    found = stale_reasons(store, store.artifacts(), {"ingest": 1, "fuse": 1} | versions, raw_digest)
    return {key: reason.text for key, reason in found.items()}


def test_fresh_chain_is_current(store: Store):
    ingest(store), make(store, fake.FUSE), make(store, fake.FIT)
    assert reasons(store) == {}


def test_replaced_input_makes_what_follows_stale(store: Store):
    ingest(store)
    fuse, fit = make(store, fake.FUSE), make(store, fake.FIT)
    ingest(store, pieces=5)
    found = reasons(store)
    assert "was replaced by" in found[fuse.key]
    assert fit.key in found


def test_what_a_new_version_makes_alike_leaves_what_follows_current(store: Store):
    """It is found again by content, and the old one is as good as the new."""
    ingest(store)
    old, fit = make(store, fake.FUSE), make(store, fake.FIT)
    assert reasons(store, fuse=2)[fit.key] == f"its clouds {old.address} is stale"
    new = make(store, replace(fake.FUSE, version=2))
    assert make(store, fake.FIT).key == fit.key and new.content == old.content and new.key != old.key
    assert reasons(store, fuse=2) == {}


def test_another_seed_stands_beside(store: Store):
    ingest(store)
    make(store, fake.FUSE)
    ingest(store, seed=1)
    assert reasons(store) == {}


def test_named_recordings_of_one_environment_stand_side_by_side(store: Store):
    plain = ingest(store)
    store.set_name("plain", plain)
    make(store, fake.FUSE)
    store.set_name("mystery", ingest(store, pieces=5))
    make(store, fake.FUSE)
    assert reasons(store) == {}


def test_named_models_of_the_same_recordings_stand_side_by_side(store: Store):
    ingest(store)
    store.set_name("base", make(store, fake.FUSE))
    first = make(store, fake.FIT)
    store.set_name("base+law", make(store, fake.FUSE, upper=True))
    second = make(store, fake.FIT)
    assert first.key != second.key
    assert reasons(store) == {}
    store.set_name("base", make(store, fake.FUSE, upper=True))
    found = reasons(store)
    assert "was replaced by" in found[first.key] and second.key not in found


def test_an_input_that_was_made_again_is_followed_through_two_stages(store: Store):
    ingest(store)
    make(store, fake.FUSE), make(store, fake.FIT)
    ingest(store, pieces=5)
    fuse = make(store, fake.FUSE)
    fit = make(store, fake.FIT)
    found = reasons(store)
    assert fuse.key not in found and fit.key not in found and len(found) == 2


def test_a_name_that_moves_on_replaces(store: Store):
    store.set_name("plain", ingest(store))
    fuse = make(store, fake.FUSE)
    store.set_name("plain", ingest(store, pieces=5))
    assert fuse.key in reasons(store)


def test_changed_raw_files_and_new_version_are_told(store: Store):
    artifact = ingest(store)
    assert "version 2" in reasons(store, ingest=2)[artifact.key]
    fake.raw_folder(store.workspace / "blocks", "changed ")
    assert "have changed" in reasons(store)[artifact.key]


def test_removed_input_is_told(store: Store):
    artifact = ingest(store)
    fuse = make(store, fake.FUSE)
    for path in sorted(artifact.path.rglob("*"), reverse=True):
        path.unlink()
    artifact.path.rmdir()
    assert "is gone" in reasons(store)[fuse.key]


def test_first_difference_is_the_earliest(store: Store):
    ingest(store)
    one = make(store, fake.FUSE)
    assert first_difference(store, one, one) is None
    other = make(store, fake.FUSE, upper=True)
    assert "fuse.upper = False, True" in str(first_difference(store, one, other))
    ingest(store, pieces=5)
    third = make(store, fake.FUSE, upper=True)
    assert "ingest.pieces = 4, 5" in str(first_difference(store, one, third))
    fake.raw_folder(store.workspace / "blocks", "changed ")
    ingest(store, pieces=5)
    fourth = make(store, fake.FUSE)
    assert "raw input raw differs" in str(first_difference(store, one, fourth))
