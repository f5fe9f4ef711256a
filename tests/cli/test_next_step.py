"""The last line of `plop status`: one command, from what the workspace holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from plop.artifacts.manifest import Manifest
from plop.artifacts.stale import Stale
from plop.artifacts.store import Artifact
from plop_cli.next_step import next_step
from stages import NEXT, PIPELINE


def artifact(stage: str, *, environment: str = "block", figures: dict | None = None, **provenance) -> Artifact:
    manifest = Manifest(
        stage,
        "01" * 8,
        1,
        {},
        {},
        environment=environment,
        summary={"figures": figures or {}},
        provenance={"command": stage, **provenance},
    )
    return Artifact(Path("artifacts") / stage / ("01" * 8), manifest)


def step(*stages: str, **more) -> str:
    return next_step([artifact(stage) for stage in stages], **{"stale": {}, **more}).command


@pytest.mark.parametrize(
    ("stages", "command"),
    [
        ((), "plop ingest FOLDER"),
        (("ingest",), "plop calibrate"),
        (("simulate",), "plop fuse"),
        (("ingest", "calibrate"), "plop fuse"),
        (("ingest", "calibrate", "repair"), "plop fuse --recordings repair@01010101"),
        (("train", "diagnose", "repair"), "plop diagnose --model train@01010101 --recordings repair@01010101"),
        (("ingest", "calibrate", "fuse"), "plop fit-init"),
        (("fuse", "ingest", "fit-init"), "plop train"),
        (("ingest", "fit-init", "train"), "plop rollout"),
        (("ingest", "fit-init", "train", "filter"), "plop rollout"),
        (("ingest", "fit-init", "filter"), "plop identify"),
        (("fit-init", "train", "rollout"), "plop eval"),
        (("fit-init", "train", "rollout", "eval"), "plop compare --model train@01010101"),
        (("fit-init", "identify"), "plop compare --model identify@01010101"),
        (("train", "eval", "compare"), "plop diagnose --model train@01010101"),
        (("train", "compare", "diagnose"), "plop augment --model train@01010101"),
        (("train", "diagnose", "augment"), "plop report"),
        (("train", "diagnose", "augment", "report"), "plop export report@01010101 OUT"),
    ],
)
def test_what_follows_on_what_is_there(stages, command):
    assert step(*stages) == command


def test_every_stage_of_the_pipeline_has_a_successor_that_is_a_command():
    names = {ref.name for ref in PIPELINE}
    assert set(NEXT) == names - {"report", "plan"} and set(NEXT.values()) <= names


def test_cameras_that_are_all_bad_come_before_anything_is_made_from_them():
    bad = artifact("calibrate", figures={"cameras_good": 0, "cameras_corrected": 0, "cameras_bad": 2})
    assert next_step([artifact("ingest"), bad], stale={}).command == "plop calibrate --handeye FOLDER"
    some = artifact("calibrate", figures={"cameras_good": 1, "cameras_bad": 2})
    assert next_step([some], stale={}).command == "plop fuse"


def test_what_is_stale_is_made_again():
    artifacts = [artifact("fit-init"), artifact("ingest"), artifact("fuse")]
    stale = {
        ("fuse", "01" * 8): Stale("an input is stale", follows=True),
        ("fit-init", "01" * 8): Stale("the stage is now version 8"),
    }
    found = next_step(artifacts, stale=stale)
    assert found.command == "plop repro" and "fit-init@01010101, the stage is now version 8" in found.why


def test_damage_comes_first_then_what_was_begun():
    keys = [("fuse", "01" * 8)]
    stale = {("ingest", "01" * 8): Stale("raw has changed")}
    repaired = next_step([artifact("fuse")], stale=stale, damaged=keys, unfinished=[("train", "ff")])
    assert repaired.command == "plop repro" and "damaged" in repaired.why
    assert step("ingest", "fuse", stale=stale, unfinished=[("train", "ff")]) == "plop train"


def test_workspace_and_environment_are_named_where_needed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    two = [artifact("ingest", environment="a"), artifact("ingest", environment="big block")]
    (tmp_path / "my ws").mkdir()
    assert next_step(two, stale={}, workspace=tmp_path).command == "plop calibrate --env 'big block'"
    assert next_step(two[:1], stale={}, workspace=tmp_path / "my ws").command == "plop calibrate -w 'my ws'"
    assert next_step([], stale={}, workspace=tmp_path / "my ws").command == "plop ingest FOLDER -w 'my ws'"
