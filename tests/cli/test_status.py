"""status, verify, why, export and names."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from plop_cli.app import main
from tests.pipeline import fake_stages as fake


def test_status_verify_why_and_export(workspace: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["status"]) == 0
    assert "no artifacts" in capsys.readouterr().out
    raw = str(workspace / "blocks")
    assert main(["ingest", "mesh", raw, "--name", "base", "-q"]) == 0
    assert main(["calibrate", "-q", "--name", "joined"]) == 0
    assert main(["ingest", "mesh", raw, "--pieces", "5", "--name", "more", "-q"]) == 0
    assert main(["status", "--json", "--all"]) == 0
    rows = {row["name"]: row["state"] for row in json.loads(capsys.readouterr().out)["artifacts"]}
    assert rows["base"] == rows["more"] == rows["joined"] == "current"  # what has a name is not replaced
    assert main(["why", "base", "more"]) == 0
    assert "ingest.pieces = 4, 5" in capsys.readouterr().out
    assert main(["verify"]) == 0
    assert main(["export", "joined", str(workspace / "out")]) == 0
    assert (workspace / "out" / "sub" / "all.txt").exists()
    assert (workspace / "out" / "manifest.json").exists()
    assert main(["export", "joined", str(workspace / "out")]) == 1
    assert main(["export", "joined", str(workspace / "out"), "--force"]) == 0
    assert main(["export", "joined", str(workspace / "out2"), "--kind", "video"]) == 1
    capsys.readouterr()
    (next((workspace / "artifacts" / "calibrate").glob("[!.]*")) / "sub" / "all.txt").write_text("x")
    assert main(["verify"]) == 1
    assert "all.txt" in capsys.readouterr().err


def test_status_says_why_something_is_stale_where_it_begins(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    assert main(["ingest", "mesh", str(workspace / "blocks"), "-q"]) == 0
    assert main(["calibrate", "-q"]) == 0
    newer = {"ingest": dataclasses.replace(fake.INGEST, version=fake.INGEST.version + 1)}
    monkeypatch.setattr("plop.pipeline.staleness._imported_stages", lambda artifacts: newer)
    capsys.readouterr()
    assert main(["status"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if line]
    rows = [line[line[0] == "└" :] for line in lines]  # a branch of the tree comes first
    states = {row[0].partition("@")[0]: row[-1] for row in rows if "@" in row[0]}
    assert states == {"ingest": "stale", "calibrate": "stale"}
    reasons = [line for line in lines if line[0] == "stale:"]
    assert len(reasons) == 1 and reasons[0][1].startswith("ingest@"), "what follows from it is not explained again"


@pytest.mark.parametrize("harm", [lambda path: path.write_text("x"), Path.unlink])
def test_status_tells_what_is_damaged(
    workspace: Path, capsys: pytest.CaptureFixture[str], harm: Callable[[Path], object]
):
    assert main(["ingest", "mesh", str(workspace / "blocks"), "-q"]) == 0
    assert main(["calibrate", "-q"]) == 0
    harm(next((workspace / "artifacts" / "ingest").glob("[!.]*/piece_1.txt")))
    capsys.readouterr()
    assert main(["status", "--json"]) == 0
    seen = capsys.readouterr()
    states = {row["artifact"].partition("@")[0]: row["state"] for row in json.loads(seen.out)["artifacts"]}
    assert states["ingest"].startswith("damaged: ") and states["ingest"].endswith("piece_1.txt")
    assert states["calibrate"] == "current"
    assert "damaged" in seen.err and "plop ingest" in seen.err and "--force" in seen.err


def test_a_name_that_moves_is_said(workspace: Path, capsys: pytest.CaptureFixture[str]):
    command = ["ingest", "mesh", str(workspace / "blocks"), "--name", "base"]
    assert main(command) == 0
    assert "moved" not in capsys.readouterr().out
    assert main([*command, "--pieces", "5"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if "the name base moved" in line)
    assert line.count("ingest@") == 2 and " -> " in line
