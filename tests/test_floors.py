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


def package(module: str, depth: int) -> str:
    """The folder so many steps down that holds a module; a module higher up stands for itself."""
    return ".".join(module.split(".")[:depth])


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


@pytest.mark.parametrize("depth", [2, 3])
def test_no_package_of_the_library_imports_round(depth: int):
    graph: dict[str, set[str]] = {}
    for module in modules():
        if module.startswith("plop."):
            used = {package(name, depth) for name in imports(module) if name.startswith("plop.")}
            graph.setdefault(package(module, depth), set()).update(used - {package(module, depth)})
    assert circles(graph) == []
    outside = {name: used for name, used in graph.items() if not name.startswith("plop.pipeline")}
    assert [n for n, used in outside.items() if any(u.startswith("plop.pipeline") for u in used)] == []  # it uses them


def test_laws_see_a_body_not_the_engine_s_inner_parts():
    inner = {"plop.physics.engine.engine", "plop.physics.engine.solver"}
    laws = [module for module in modules() if module.startswith("plop.physics.effects.")]
    assert len(laws) > 20 and [module for module in laws if imports(module) & inner] == []


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
