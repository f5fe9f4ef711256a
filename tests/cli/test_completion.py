"""The version, and what the shell is told when it completes a command."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from plop.pipeline.registry import StageRef
from plop_cli.app import main
from stages import PIPELINE

INGEST = "tests.pipeline.fake_stages:INGEST"


def completed(words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Complete the last of the words, as bash asks."""
    monkeypatch.setenv("_PLOP_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split(" ")) - 1))
    with pytest.raises(SystemExit) as ended:
        main([])
    assert not ended.value.code
    return capsys.readouterr().out.split()


def test_names_of_stages_and_commands_are_completed(monkeypatch, capsys):
    names = completed("plop ", monkeypatch, capsys)
    assert {ref.name for ref in PIPELINE} | {"demo", "status", "doctor"} <= set(names)
    assert completed("plop fit", monkeypatch, capsys) == ["fit-init"]


def test_formats_are_completed(monkeypatch, capsys):
    assert completed("plop ingest ", monkeypatch, capsys) == ["disect", "mesh", "droid"]
    assert completed("plop ingest d", monkeypatch, capsys) == ["disect", "droid"]
    assert completed("plop ingest nothing ", monkeypatch, capsys) == []


def test_options_of_a_stage_are_completed(monkeypatch, capsys):
    load = StageRef.load
    monkeypatch.setattr(StageRef, "load", lambda ref: load(StageRef(ref.command, INGEST, "")))
    assert completed("plop ingest mesh --pau", monkeypatch, capsys) == ["--pause-s"]
    assert completed("plop train --pau", monkeypatch, capsys) == ["--pause-s"]
    assert completed("plop train --seed 3 --dry", monkeypatch, capsys) == ["--dry-run"]


def test_no_stage_is_imported_to_complete_a_name_or_a_file(monkeypatch, capsys):
    monkeypatch.setattr(StageRef, "load", lambda ref: pytest.fail(f"{ref.command} was imported"))
    assert completed("plop train ", monkeypatch, capsys) == completed("plop ingest mesh ./", monkeypatch, capsys) == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_for_a_shell_is_shown(shell: str):
    code = f"from plop_cli.app import main; main(['--show-completion', '{shell}'])"
    root = Path(__file__).resolve().parents[2]
    named = os.environ | {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}  # else that of the process above: sh
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=root, env=named)
    assert done.returncode == 0 and "_PLOP_COMPLETE" in done.stdout


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"plop {metadata.version('plop')}\n"
