"""`import plop`: its names, that it costs nothing, that it gives what the commands give, and the pages that use it."""

from __future__ import annotations

import ast
import pkgutil
import re
import runpy
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import plop
from plop.artifacts.store import Store
from plop_cli.app import main
from tests.pipeline.small_set import make_workspace

ROOT = Path(__file__).resolve().parent.parent
TUTORIAL = ROOT / "docs" / "tutorials" / "planner.py"
PAGE = ROOT / "docs" / "how-to" / "python.md"

NAMES = [
    "Artifact",
    "Band",
    "Camera",
    "DynamicsModel",
    "Effect",
    "Estimate",
    "FrameErrors",
    "Gaussians",
    "InitialScene",
    "Material",
    "Parameter",
    "ParticleState",
    "PlopError",
    "Recording",
    "RecordingSet",
    "Scene",
    "Store",
    "ToolStep",
    "Verdict",
    "augment",
    "compare",
    "diagnose",
    "effect_type",
    "ensemble_spread",
    "load_model",
    "read_splat",
    "render_scene",
    "rollout",
    "run",
    "simulate",
]
"""Taking one away breaks the programs of users; a new one is a promise."""

SCENE = """
name = "block"
episodes = 4
motions = ["push", "hold"]
frame_rate_hz = 20
spacing_m = 0.0125
[shape]
kind = "block"
size_m = [0.08, 0.05, 0.04]
[motion]
hold_s = [0.1, 0.1]
"""
SETTINGS = """
[simulate]
episodes = 2
jobs = 1
[simulate.cameras]
size = 40
count = 3
supersample = 1
[fit-init]
count = 100
steps = 20
tool_count = 40
virtual_views = 0
[filter.update]
iterations = 3
[identify]
fit = ["table_friction"]
iterations = 1
spacing_m = 0.0125
jobs = 1
"""


def test_the_public_names():
    assert sorted(plop.__all__) == sorted(NAMES)
    for name in NAMES:
        assert getattr(plop, name) is getattr(plop, name) and getattr(plop, name).__doc__, name
    assert set(NAMES) <= set(dir(plop))
    assert plop.__version__ == metadata.version("plop")
    with pytest.raises(AttributeError, match="no attribute 'rnu'"):
        plop.rnu


def test_no_public_name_is_a_package():
    assert not set(NAMES) & {module.name for module in pkgutil.iter_modules(plop.__path__)}


def test_the_import_loads_nothing_else():
    code = "import sys; known = set(sys.modules); import plop; print(sorted(m for m in set(sys.modules) - known))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    ours = {name for name in ast.literal_eval(done.stdout) if name.split(".")[0] not in sys.stdlib_module_names}
    assert ours == {"plop", "plop.compute", "plop.compute.plain", "plop.compute.waiting"}


def test_run_gives_the_artifact_of_the_command(tmp_path):
    raw = make_workspace(tmp_path)
    assert main(["ingest", "mesh", str(raw), "-w", str(tmp_path), "-q", "--name", "typed", "--set", "seed=2"]) == 0
    again = plop.run("ingest mesh", plop.Store(tmp_path), raw=raw, seed=2, name="called")
    assert again.key == Store(tmp_path).find("typed").key and len(Store(tmp_path).artifacts("ingest")) == 1
    fused = plop.run("fuse", tmp_path, recordings=again, voxel_m=0.004)
    assert main(["fuse", "-w", str(tmp_path), "-q", "--recordings", "typed", "--voxel-m", "0.004"]) == 0
    assert [artifact.key for artifact in Store(tmp_path).artifacts("fuse")] == [fused.key]


@pytest.mark.parametrize(
    ("command", "options", "words"),
    [
        ("fuze", {}, ["Did you mean fuse?"]),
        ("fuse", {"voxl_m": 1}, ["fuse has no setting 'voxl_m'", "voxel_m"]),
        ("fuse", {"voxel_m": "wide"}, ["fuse.voxel_m", "number"]),
        ("fuse", {"recordings": 3}, ["neither an artifact nor an address"]),
        ("fuse", {"recordings": "nothing@latest"}, ["no workspace here yet"]),
    ],
)
def test_what_cannot_be_run_is_refused_as_the_command_does(tmp_path, command, options, words):
    with pytest.raises(plop.PlopError) as caught:
        plop.run(command, tmp_path, **options)
    assert all(word in caught.value.render() for word in words)


def test_a_misspelt_workspace_is_not_made(tmp_path):
    with pytest.raises(plop.PlopError, match="no such workspace|There is no"):
        plop.run("fuse", tmp_path / "nothere")
    assert not (tmp_path / "nothere").exists()


def test_the_tutorial_imports_plop_alone():
    for text in (TUTORIAL.read_text(), six_lines()):
        found = [node for node in ast.walk(ast.parse(text)) if isinstance(node, (ast.Import, ast.ImportFrom))]
        assert [ast.unparse(node) for node in found] == ["import plop"]
        used = {
            node.attr
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "plop"
        }
        assert used <= set(NAMES)


def six_lines() -> str:
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[0]


def test_the_tutorial_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    (tmp_path / "block.toml").write_text(SCENE)
    (tmp_path / "planner").mkdir()
    (tmp_path / "planner" / "plop.toml").write_text(SETTINGS)
    told = runpy.run_path(str(TUTORIAL))
    assert np.isfinite(told["errors"]["cd_mm"]).all() and (tmp_path / "error.png").stat().st_size > 0
    assert told["distance_m"](told["state"]) < told["distance_m"](told["states"][told["start"]])
    assert "plan ['" in capsys.readouterr().out
    lines = six_lines()
    assert len([line for line in lines.splitlines() if line.strip()]) <= 6
    (tmp_path / "error.png").unlink()
    exec(compile(lines, str(PAGE), "exec"), {})
    assert (tmp_path / "error.png").stat().st_size > 0
