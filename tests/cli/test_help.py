"""What `--help` shows, and that it imports nothing heavy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from plop_cli.app import main
from stages import PIPELINE

REPOSITORY = Path(__file__).resolve().parents[2]


def test_help_lists_the_pipeline_in_order(capsys: pytest.CaptureFixture[str]):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    places = [text.index(f" {name} ") for name in dict.fromkeys(ref.name for ref in PIPELINE)]
    assert places == sorted(places)


@pytest.mark.parametrize("words", [[], ["status"], ["simulate"], ["ingest"], ["ingest", "disect"]])
def test_help_is_short_for_the_hasty(words: list[str], capsys: pytest.CaptureFixture[str]):
    assert main([*words, "-h"]) == 0
    assert f"Usage: {' '.join(['plop', *words])} [OPTIONS]" in capsys.readouterr().out


def test_help_imports_nothing_heavy():
    heavy = ("torch", "numpy", "open3d", "numba", "cv2", "h5py")
    code = f"import sys; from plop_cli.app import main; main(['--help']); print('HEAVY', sys.modules.keys() & {heavy})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY, check=True)
    assert "HEAVY set()" in done.stdout


def test_help_of_a_stage_shows_types_defaults_and_units(workspace: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["ingest", "mesh", "--help"]) == 0
    text = capsys.readouterr().out
    for part in (
        "--pause-s",
        "Time a piece takes. [0 to 60 s; default 0]",
        "--seed",
        "RAW",
        "--dry-run",
        "PLOP_WORKSPACE",
    ):
        assert part in text


def test_help_says_what_an_input_is_and_what_is_made_on_the_way(monkeypatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setenv("COLUMNS", "300")
    assert main(["diagnose", "--help"]) == 0
    shown = {line.split()[1]: line for line in capsys.readouterr().out.splitlines() if "--" in line}
    assert "the filter's states. Address of an artifact of filter. [default: (made if missing)]" in shown["--tracks"]
    assert "(made if missing, or none)" in shown["--reference-tracks"]
    assert "(the latest match)" in shown["--model"]
