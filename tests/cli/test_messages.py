"""What the program says at once, where there is no workspace, and how missing parts are installed."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

import plop.installed as installed
from plop.artifacts.store import Store
from plop_cli import doctor
from plop_cli.app import main
from plop_cli.console import Console

REPOSITORY = Path(__file__).resolve().parents[2]


def test_a_stage_says_what_it_does_before_anything_heavy_is_imported(tmp_path):
    code = (
        "import sys; from plop.pipeline.registry import StageRef\n"
        "StageRef.load = lambda ref: sys.exit('HEAVY %s' % (sys.modules.keys() & {'torch', 'numpy', 'open3d'}))\n"
        "import plop_cli.app as app, time; app.main(['train'])"
    )
    for extra in ("", "--quiet", "--json"):
        run = [sys.executable, "-c", code.replace("['train']", f"['train', *{extra.split()}]")]
        process = subprocess.Popen(run, stderr=subprocess.PIPE, text=True, cwd=REPOSITORY)
        said = process.communicate()[1]
        assert ("plop train: Learn the dynamics" in said.splitlines()[0]) == (not extra)


def test_what_is_said_at_once_comes_before_seconds_of_imports(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("plop.pipeline.registry.StageRef.load", lambda ref: (_ for _ in ()).throw(KeyboardInterrupt))
    begin = time.process_time()
    assert main(["fuse", "-w", str(tmp_path)]) == 130
    assert time.process_time() - begin < 0.3
    assert capsys.readouterr().err.startswith("plop fuse: Fuse the views")


@pytest.mark.parametrize(
    "words",
    [["status"], ["verify"], ["why", "a", "b"], ["export", "a", "out"], ["view", "a"], ["calibrate"], ["report"]],
)
def test_no_workspace_is_said_and_none_is_made(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    assert main([*words, "-w", "nothere"]) == 1
    said = capsys.readouterr().err
    assert "no such workspace" in said and "plop ingest" in said and "plop demo" in said
    assert not (tmp_path / "nothere").exists()


def test_a_workspace_that_is_a_file(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert main(["status", "-w", str(tmp_path / "file")]) == 1
    assert "there is a file at its path" in capsys.readouterr().err


def test_status_of_an_empty_folder_ends_with_how_to_begin(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["status"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("next: plop ingest FOLDER ")
    assert main(["status", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["next"]["command"] == "plop ingest FOLDER"


@pytest.mark.parametrize(
    ("folder", "pip", "command"),
    [
        (None, True, "pip install 'plop[view]'"),
        (None, False, "uv pip install 'plop[view]'"),
        (".", True, "pip install -e '.[view]'"),
        ("/src/my plop", True, "pip install -e '/src/my plop[view]'"),
    ],
)
def test_remedies_fit_how_plop_was_installed(monkeypatch, folder, pip, command):
    here = Path.cwd() if folder == "." else folder and Path(folder)
    monkeypatch.setattr(installed, "checkout", lambda: here)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object() if pip else None)
    assert installed.install_extra("view") == command


def test_a_checkout_is_told_from_a_wheel(monkeypatch, tmp_path):
    class Distribution:
        def __init__(self, text):
            self.text = text

        def read_text(self, name):
            return self.text

    assert installed.checkout() == REPOSITORY
    monkeypatch.setattr(installed, "SOURCE", tmp_path)  # as in site-packages: no pyproject.toml
    for text, folder in (
        (None, None),
        ('{"url": "file:///wheels/plop.whl", "archive_info": {}}', None),
        ('{"url": "file:///src/my%20plop", "dir_info": {"editable": true}}', Path("/src/my plop")),
    ):
        monkeypatch.setattr(installed.metadata, "distribution", lambda name, text=text: Distribution(text))
        assert installed.checkout() == folder


def test_doctor_groups_needed_and_optional(tmp_path, monkeypatch, capsys):
    def broken(store):
        raise ImportError("libGL.so.1")

    parts = (
        doctor.Part(
            "viewer", lambda store: doctor.Look(False, "not installed", "get it"), needed=False, use="for looking"
        ),
        doctor.Part("python", lambda store: doctor.Look(True, "3")),
    )
    monkeypatch.setattr(doctor, "PARTS", parts)
    assert doctor.show(Store(tmp_path), Console()) == 0
    said = capsys.readouterr().out
    assert said.index("needed") < said.index("python") < said.index("viewer") and "for looking" in said
    monkeypatch.setattr(doctor, "PARTS", (*parts, doctor.Part("open3d", broken)))
    assert doctor.show(Store(tmp_path), Console()) == 1
    assert "needs repair: open3d" in capsys.readouterr().out
    assert [finding.state for finding in doctor.examine(Store(tmp_path))] == ["ok", "problem", "optional"]
