"""The table of what made-up episodes change."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.made_up import METRICS, collected, table
from plop.artifacts.store import Store
from plop.errors import PlopError
from plop_cli.execute import execute
from tests.pipeline import fake_stages as fake


def scores(value: float) -> dict[str, dict[str, float]]:
    return {over: dict.fromkeys(METRICS, value + (over == "end")) for over in ("episode", "end")}


def test_part_recordings_are_averaged_and_plain_cuts_left_out():
    found = {"with made-up episodes": {"a_part_004": scores(1), "a_part_005": scores(2), "a_001": scores(50)}}
    mean = {"mean": 3.0}
    without = {"a": {"plop": {**dict.fromkeys(METRICS, mean), "end": dict.fromkeys(METRICS, mean)}}}
    rows = table({"a": found}, without).splitlines()[2:]
    assert rows[0].startswith("| a | without | 3.00, 3.00 |")
    assert rows[1] == ("| a | with made-up episodes | 1.50, 2.50 | 1.50, 2.50 | 1.50, 2.50 | 1.5, 2.5 | 1.500, 2.500 |")


def test_a_workspace_gives_what_is_named_in_it(tmp_path: Path):
    store = Store(tmp_path)
    with pytest.raises(PlopError, match="nothing to collect"):
        collected(store)
    raw = fake.raw_folder(tmp_path / "blocks")
    artifact = execute(fake.INGEST, store=store, config=fake.PiecesConfig(), inputs={"raw": raw}).artifact
    facts = {"environment": "prism-jelly", "episodes": {"prism_jelly_part_004": {"plop": scores(1.0)}}}
    (artifact.path / "scores.json").write_text(json.dumps(facts))
    store.set_name("engine-eval", artifact)
    environment, found = collected(store)
    assert environment == "prism-jelly"
    assert found == {"the engine itself": {"prism_jelly_part_004": scores(1.0)}}
