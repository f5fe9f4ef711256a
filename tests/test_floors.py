"""Who may import whom: plop_cli -> stages -> plop, never up and never round."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FLOORS = ("plop", "stages", "plop_cli")
"""From the ground up: each uses those before it."""


@cache
def modules() -> dict[str, Path]:
    found = {}
    for floor in FLOORS:
        for path in (ROOT / floor).rglob("*.py"):
            found[".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")] = path
    return found


@cache
def imports(module: str, *, annotations: bool = True) -> frozenset[str]:
    """Modules of ours that a module imports anywhere: at its top, in a function or, if wanted, for its annotations."""
    found, tree = set(), ast.parse(modules()[module].read_text())
    if not annotations:
        tree.body = [
            node for node in tree.body if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
        ]
    for node in ast.walk(tree):
        named = []
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relatively"
            named = [f"{node.module}.{alias.name}" for alias in node.names]
            named = [name if name in modules() else str(node.module) for name in named]
        elif isinstance(node, ast.Import):
            named = [alias.name for alias in node.names]
        found |= {name for name in named if name in modules()}
    return frozenset(found - {module})


def package(module: str) -> str:
    """The folder below a floor that holds a module; a module right on a floor stands for itself."""
    return ".".join(module.split(".")[:2])


def circles(graph: dict[str, set[str]]) -> list[frozenset[str]]:
    """Sets of nodes that reach one another."""

    def reached(start: str) -> set[str]:
        seen: set[str] = set()
        todo = [start]
        while todo:
            new = graph.get(todo.pop(), set()) - seen
            seen |= new
            todo += new
        return seen

    reach = {node: reached(node) for node in graph}
    found = {frozenset(o for o in reach[node] if node in reach.get(o, ())) for node in graph if node in reach[node]}
    return sorted(found, key=sorted)


@pytest.mark.parametrize("floor", FLOORS)
def test_no_floor_imports_from_above(floor: str):
    above = FLOORS[FLOORS.index(floor) + 1 :]
    wrong = [
        (module, used)
        for module in modules()
        if module.split(".")[0] == floor
        for used in imports(module)
        if used.split(".")[0] in above
    ]
    assert wrong == []


def test_no_package_of_the_library_imports_round():
    graph: dict[str, set[str]] = {}
    for module in modules():
        if module.startswith("plop."):
            used = {package(name) for name in imports(module) if name.startswith("plop.")}
            graph.setdefault(package(module), set()).update(used - {package(module)})
    assert circles(graph) == []
    assert [name for name, used in graph.items() if "plop.pipeline" in used] == []  # the runner uses the library


def test_no_file_imports_round():
    assert circles({module: set(imports(module, annotations=False)) for module in modules()}) == []


def test_circles_are_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [frozenset({"b", "c"})]


def test_the_runner_imports_no_stage_before_one_runs():
    code = (
        "import sys, plop.pipeline.run, plop.pipeline.chain\n"
        "print([name for name in sys.modules if name.startswith('stages')])\n"
        "from plop.pipeline.registry import commands; commands()\n"
        "print([name for name in sys.modules if name.startswith('stages')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.splitlines() == ["[]", "['stages']"]
