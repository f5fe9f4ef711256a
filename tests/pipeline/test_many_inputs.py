"""An input that takes several artifacts: in order, by address, each checked like any other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.pipeline.execute import execute
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary
from tests.pipeline import fake_stages as fake


@dataclass(frozen=True)
class NoConfig:
    """No settings."""


def _list_inputs(inputs: Inputs, config: NoConfig, out: Output) -> Summary:
    told = {key: item.manifest.fingerprint for key, item in inputs.items() if item.manifest}
    (out.path / "a.txt").write_text(str(told))
    return Summary({"given": list(told), "of": list(told.values())})


JOIN = Stage("join", 1, "Join several.", NoConfig, {"sets": InputSpec(("ingest",), "sets", many=True)}, _list_inputs)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path)


def ingest(store: Store, pieces: int) -> Artifact:
    raw = fake.raw_folder(store.workspace / "blocks", "blocks ")
    return execute(fake.INGEST, store=store, config=fake.PiecesConfig(pieces=pieces), inputs={"raw": raw}).artifact


def joined(store: Store, *artifacts: Artifact) -> Artifact:
    addresses = ", ".join(a.address for a in artifacts)
    return execute(JOIN, store=store, inputs={"sets": addresses}).artifact


def test_they_arrive_numbered_in_the_order_given(store):
    one, two = ingest(store, 1), ingest(store, 2)
    forward, backward = joined(store, one, two), joined(store, two, one)
    assert forward.manifest.summary["figures"] == {"given": ["sets.0", "sets.1"], "of": [one.key[1], two.key[1]]}
    assert backward.manifest.summary["figures"]["of"] == [two.key[1], one.key[1]]
    assert forward.key != backward.key and set(forward.manifest.inputs) == {"sets.0", "sets.1"}


def test_without_an_address_it_is_the_latest(store):
    ingest(store, 1)
    two = ingest(store, 2)
    assert execute(JOIN, store=store).artifact.manifest.summary["figures"]["of"] == [two.key[1]]


def test_one_of_another_stage_is_refused(store):
    one = ingest(store, 1)
    other = execute(fake.CALIBRATE, store=store).artifact
    with pytest.raises(PlopError, match="cannot be the sets"):
        joined(store, one, other)
