"""Where the results of `plop reproduce` go, and by which command they say that they were made."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from plop.errors import PlopError
from plop.metrics.scores import Scores
from plop_cli.app import main

ENVIRONMENTS = ("prism-jelly", "sphere-foam")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a folder with recordings of two environments, in which nothing is really run."""
    (tmp_path / "raw").mkdir()
    for name in ENVIRONMENTS:
        (tmp_path / "raw" / f"{name.replace('-', '_')}_part_000.npz").touch()
    parts = {part: {"cd_mm": 1.0} for part in ("episode", "end", "start")}
    methods = dict.fromkeys(("plop", "persistence"), parts)
    Scores(
        environment="x",
        method="plop",
        seed=0,
        conventions={"cd_mm": "..."},
        unavailable={},
        notes=(),
        methods={name: {part: {"cd_mm": None} for part in parts} for name in methods},
        better_than_persistence_percent={},
        episodes={"x_part_000": methods},
    ).write(tmp_path)
    monkeypatch.chdir(tmp_path)
    made(monkeypatch, failing=())
    return tmp_path


def made(monkeypatch: pytest.MonkeyPatch, failing: tuple[str, ...]) -> None:
    def scored(store: object, console: object, data: Path, names: list[str], *others: object) -> Iterator[tuple]:
        for name in reversed(names):  # as they finish
            yield name, PlopError("It failed.") if name in failing else [data.resolve().parent / "scores.json"]

    monkeypatch.setattr("plop_cli.reproduce._scored", scored)


def results(path: Path) -> tuple[str, list[str]]:
    found = json.loads(path.read_text())
    return found["command"], sorted(found["environments"])


def test_all_environments_go_into_the_documentation(place: Path) -> None:
    (place / "reproduce").mkdir()
    (place / "reproduce" / "plop.toml").write_text("[compare]\nframes = 1\n")  # of no stage that runs
    assert main(["reproduce", "raw", "-q"]) == 0
    command = "make reproduce DATA=<folder> PROFILE=cpu"
    for folder in ("docs", "reproduce"):
        assert results(place / folder / "results" / "disect.json") == (command, list(ENVIRONMENTS))


@pytest.mark.parametrize(
    ("options", "typed", "found"),
    [
        (["--env", "prism-jelly"], "--env prism-jelly", ["prism-jelly"]),
        (["--set", "train.seed=1"], "--set train.seed=1", list(ENVIRONMENTS)),
    ],
)
def test_what_is_not_all_with_the_profiles_settings_stays_in_the_workspace(
    place: Path, options: list[str], typed: str, found: list[str]
) -> None:
    assert main(["reproduce", "raw", "-q", *options]) == 0
    path = place / "reproduce" / "results" / "disect.json"
    assert results(path) == (f"plop reproduce <folder> --profile cpu {typed}", found)
    assert not (place / "docs").exists()


def test_settings_of_the_workspace_are_told(place: Path) -> None:
    (place / "reproduce").mkdir()
    (place / "reproduce" / "plop.toml").write_text("[train]\nseed = 1\n")
    assert main(["reproduce", "raw", "-q"]) == 0
    command, _ = results(place / "reproduce" / "results" / "disect.json")
    assert command.endswith("PROFILE=cpu (with plop.toml)") and not (place / "docs").exists()


def test_results_with_more_environments_stay(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "raw", "-q"]) == 0
    before = (place / "docs" / "results" / "disect.json").read_bytes()
    made(monkeypatch, failing=("sphere-foam",))
    assert main(["reproduce", "raw", "-q"]) == 1
    assert "also contain sphere-foam, which this run lacks" in capsys.readouterr().err
    assert main(["reproduce", "raw", "-q", "--env", "prism-jelly", "--out", "docs"]) == 0
    assert (place / "docs" / "results" / "disect.json").read_bytes() == before
    assert results(place / "reproduce" / "results" / "disect.json")[1] == ["prism-jelly"]
