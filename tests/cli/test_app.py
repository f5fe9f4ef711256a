"""The program: exit codes, messages, machine-readable output."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from plop_cli.app import main

REPOSITORY = Path(__file__).resolve().parents[2]


def test_run_skip_and_json(workspace: Path, capsys: pytest.CaptureFixture[str]):
    command = ["ingest", "mesh", str(workspace / "blocks"), "--pieces", "3", "--name", "base"]
    assert main(command) == 0
    assert "done in" in capsys.readouterr().out
    assert main(command) == 0
    assert "exists already" in capsys.readouterr().out
    assert main([*command, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["skipped"] is True
    assert facts["figures"]["pieces"] == 3
    assert main(["calibrate", "--recordings", "base", "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_settings_from_file_set_and_option(workspace: Path, capsys: pytest.CaptureFixture[str]):
    (workspace / "plop.toml").write_text("[ingest.mesh]\npieces = 2\nseed = 5\n")
    base = ["ingest", "mesh", str(workspace / "blocks"), "--dry-run", "--json"]
    for extra, expected in (
        ([], 2),
        (["--set", "pieces=6"], 6),
        (["--set", "ingest.mesh.pieces=7"], 7),
        (["--set", "pieces=6", "--pieces", "8"], 8),
    ):
        assert main([*base, *extra]) == 0
        assert json.loads(capsys.readouterr().out)["config"]["pieces"] == expected
    assert not (workspace / "artifacts" / "ingest").exists()


def test_what_is_on_can_be_turned_off(workspace: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["ingest", "mesh", str(workspace / "blocks"), "-q"]) == 0
    (workspace / "plop.toml").write_text("[calibrate]\nupper = true\n")
    for extra, expected in (([], True), (["--no-upper"], False), (["--upper"], True)):
        assert main(["calibrate", "--dry-run", "--json", *extra]) == 0
        assert json.loads(capsys.readouterr().out)["config"]["upper"] is expected


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["calibrate"], 1, ["needs the input", "plop ingest"]),
        (["calibrate", "--set", "uper=1"], 1, ["no setting 'uper'", "upper"]),
        (["calibrate", "--recordings", "ingest@ff"], 1, ["no workspace here yet"]),
        (["ingest", "mesh", "nowhere"], 1, ["no such file"]),
        (["ingest", "mesh"], 2, ["RAW"]),
        (["calibrate", "--nonsense"], 2, ["--nonsense"]),
        (["calibarte"], 2, ["calibarte"]),
        (["export", "train@latest", "out"], 1, ["no workspace here yet", "plop ingest"]),
        (["why", "a", "b"], 1, ["no workspace here yet"]),
        (["reproduce", "nowhere"], 1, ["no such folder"]),
        (["reproduce", "nowhere", "--profile", "demo"], 1, ["expected: cpu, cpu-recordings, droid, paper\n"]),
        (["ingest", "mesh", "nowhere", "--pieces", "abc"], 1, ["ingest.mesh.pieces", "integer", "'abc'"]),
        (["ingest", "mesh", "nowhere", "--pause-s", "nan"], 1, ["ingest.mesh.pause_s", "finite"]),
        (["ingest", "mesh", "nowhere", "--seed", "-1"], 1, ["ingest.mesh.seed", "0 or more"]),
        (["demo", "--seed", "-1"], 1, ["command line: seed", "0 or more"]),
        (["demo-physics", "--seed", "abc"], 1, ["command line: seed", "integer"]),
        (["ingest", "mesh", "nowhere", "--pieces"], 2, ["--pieces"]),
        (["calibrate", "--set", "upper"], 1, ["KEY=VALUE"]),
        (["demo", "--set", "fse.voxel_m=1"], 1, ["Did you mean --set fuse.voxel_m=1?"]),
        (["rollout", "--backend", "gpu", "--dry-run"], 1, ["rollout.backend", "numba", "plop rollout --help"]),
        (["fit-init", "--lr-means", "-1", "--dry-run"], 1, ["fit-init.lr_means", "0 to 1", "found: -1"]),
        (
            ["ingest", "disect", "nowhere", "--cameras.size", "2", "--dry-run"],
            1,
            ["ingest.disect.cameras.size", "8 to 8192 px", "ingest disect --help"],
        ),
    ],
)
def test_mistakes_end_with_a_message_and_no_traceback(
    workspace: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, words: list[str]
):
    assert main(arguments) == code
    seen = capsys.readouterr()
    assert "Traceback" not in seen.err + seen.out
    for word in words:
        assert word in seen.err


@pytest.mark.parametrize(
    "command",
    [["status"], ["verify"], ["ingest", "mesh", "."], ["demo"], ["demo-physics"], ["reproduce", "."], ["doctor"]],
)
def test_a_file_given_as_workspace_is_named_with_the_option(
    workspace: Path, capsys: pytest.CaptureFixture[str], command: list[str]
):
    file = workspace / "file"
    file.write_text("kept")
    assert main([*command, "-w", str(file)]) == 1
    told = capsys.readouterr().err
    assert str(file) in told and "-w (--workspace)" in told and "unexpected" not in told
    assert file.read_text() == "kept"


def test_export_needs_a_folder(workspace: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["ingest", "mesh", str(workspace / "blocks"), "--name", "base", "-q"]) == 0
    assert main(["calibrate", "--name", "joined", "-q"]) == 0
    (workspace / "file").write_text("kept")
    (workspace / "out").mkdir()
    (workspace / "out" / "sub").write_text("kept")  # where the payload has a folder
    for target in ("file", "file/below", "out"):
        assert main(["export", "joined", str(workspace / target), "--force"]) == 1
        told = capsys.readouterr().err
        assert "unexpected" not in told and str(workspace / target.partition("/")[0]) in told
    assert (workspace / "file").read_text() == (workspace / "out" / "sub").read_text() == "kept"


def test_what_is_there_already_is_shown_again(workspace: Path, capsys: pytest.CaptureFixture[str]):
    command = ["ingest", "mesh", str(workspace / "blocks")]
    assert main(command) == 0
    first = capsys.readouterr().out.splitlines()
    assert main(command) == 0
    again = capsys.readouterr().out.splitlines()
    assert "exists already" in again[0] and again[1:] == first[1:] and any("pieces" in line for line in again)
    assert main([*command, "-q"]) == 0
    assert capsys.readouterr().out == ""


def test_force_would_run_again(workspace: Path, capsys: pytest.CaptureFixture[str]):
    command = ["ingest", "mesh", str(workspace / "blocks")]
    assert main([*command, "-q"]) == 0
    for extra, expected in (([], False), (["--force"], True)):
        assert main([*command, "--dry-run", "--json", *extra]) == 0
        assert json.loads(capsys.readouterr().out)["would_run"] is expected


def test_errors_are_json_when_asked(workspace: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["calibrate", "--json"]) == 1
    seen = capsys.readouterr()
    assert seen.out == ""
    assert "needs the input" in json.loads(seen.err)["error"]["problem"]


def test_full_disk_and_bugs_show_no_traceback(
    workspace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    assert main(["ingest", "mesh", str(workspace / "blocks"), "-q"]) == 0
    assert main(["fuse"]) == 1
    assert "disk is full" in capsys.readouterr().err
    monkeypatch.setattr("plop.pipeline.tasks.execute", lambda *a, **k: 1 / 0)
    assert main(["calibrate"]) == 1
    assert "ZeroDivisionError" in capsys.readouterr().err


def test_interrupt_says_that_pieces_are_kept(
    workspace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("plop.pipeline.tasks.execute", interrupted)
    assert main(["ingest", "mesh", str(workspace / "blocks")]) == 130
    assert "finished pieces are kept" in capsys.readouterr().err


def test_doctor_explains_every_part(workspace: Path, capsys: pytest.CaptureFixture[str]):
    main(["doctor", "--json"])
    found = {row["part"]: row for row in json.loads(capsys.readouterr().out)}
    for part in ("torch", "gsplat", "Blender", "LPIPS backbone", "ZED SDK", "open3d", "ffmpeg", "cores and memory"):
        assert found[part]["state"] in ("ok", "optional", "problem")
        assert found[part]["state"] == "ok" or found[part]["remedy"]


def test_program_runs_as_a_module(tmp_path: Path):
    done = subprocess.run(
        [sys.executable, "-m", "plop_cli", "status"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        check=False,
    )
    assert done.returncode == 0
    assert "no artifacts" in done.stdout
