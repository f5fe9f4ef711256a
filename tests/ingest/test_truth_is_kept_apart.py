"""Nothing that trains, fits, filters or predicts can reach the truth; only scoring may."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BLIND_STAGES = ("calibrate", "fuse", "fit_init", "train", "filter", "rollout")
BLIND_FLOORS = ("plop/gaussians", "plop/dynamics", "plop/render", "plop/geometry")


def blind_files() -> list[Path]:
    folders = [ROOT / "stages" / stage for stage in BLIND_STAGES] + [ROOT / floor for floor in BLIND_FLOORS]
    return [path for folder in folders for path in sorted(folder.rglob("*.py"))]


def imports_of(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def reachable(path: Path) -> set[str]:
    """Modules of plop and stages that a file imports, directly or through others."""
    waiting, seen = [path], set()
    while waiting:
        for name in imports_of(waiting.pop()):
            target = ROOT / (name.replace(".", "/") + ".py")
            if name.split(".")[0] in ("plop", "stages") and name not in seen and target.is_file():
                seen.add(name)
                waiting.append(target)
    return seen


@pytest.mark.parametrize("path", blind_files(), ids=lambda path: str(path.relative_to(ROOT)))
def test_no_blind_module_imports_the_truth_or_names_its_group(path: Path) -> None:
    assert "plop.recordings.truth" not in reachable(path)
    assert not re.search(r"""["'`]/?truth(/|["'`])""", path.read_text()), "names the group /truth"


def test_the_search_finds_an_import_through_another_module() -> None:
    assert "plop.recordings.readers.mesh.sequence" in reachable(
        ROOT / "plop" / "render" / "virtual_cameras" / "recorder.py"
    )
    assert "plop.recordings.recording" in reachable(ROOT / "plop" / "recordings" / "set.py")
    assert len(blind_files()) > 10
