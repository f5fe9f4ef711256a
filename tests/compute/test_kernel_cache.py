"""Compiled kernels on disk are valid for exactly the sources they came from."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

from plop.compute.kernel_cache import sources_digest

ROOT = Path(__file__).parents[2]
KERNEL = """
from {origin} import kernel
from constants import FACTOR

{decorator}
def scaled(x):
    return FACTOR * x
"""


def stamp(dispatcher) -> tuple:
    return dispatcher._cache._cache_file._source_stamp


def kernels() -> list[tuple[ModuleType, str]]:
    """Every kernel of the project whose machine code is kept, by its module and name."""
    folders = [
        path for path in (ROOT / "plop").rglob("*.py") if re.search(r"^@(kernel|compiled)\b", path.read_text(), re.M)
    ]
    modules = [import_module(".".join(path.relative_to(ROOT).with_suffix("").parts)) for path in folders]
    found = [(module, name) for module in modules for name in vars(module)]
    return [(m, n) for m, n in found if own(m, n) and type(getattr(m, n)._cache).__name__ != "NullCache"]


def own(module: ModuleType, name: str) -> bool:
    return getattr(getattr(module, name), "py_func", None) is not None and (
        getattr(module, name).py_func.__module__ == module.__name__
    )


def sources(module: ModuleType, name: str) -> set[Path]:
    """Files that hold what a function's machine code is made from: its own, and of all that it uses of the project."""
    found, todo = set(), [getattr(module, name).py_func]
    seen = set(todo)
    while todo:
        function = todo.pop()
        file = Path(function.__code__.co_filename)
        found.add(file)
        for statement in ast.parse(file.read_text()).body:
            if isinstance(statement, ast.ImportFrom) and str(statement.module).startswith("plop."):
                used = [
                    alias for alias in statement.names if (alias.asname or alias.name) in function.__code__.co_names
                ]
                found |= {Path(str(import_module(str(statement.module)).__file__)) for _ in used}
        for other in function.__code__.co_names:
            inner = getattr(function.__globals__.get(other), "py_func", None)
            if inner is not None and inner not in seen:
                seen.add(inner)
                todo.append(inner)
    return found


def test_every_kernel_is_stamped_with_all_sources_that_it_uses():
    found = kernels()
    assert len(found) > 40 and {m.__name__.split(".")[1] for m, _ in found} == {"physics", "dynamics", "render"}
    for module, name in found:
        stamps = stamp(getattr(module, name))[1:]
        for source in sources(module, name):
            assert any(sources_digest(folder) in stamps for folder in source.parents[:3]), f"{name} uses {source}"
    (stick,) = [(module, name) for module, name in found if name == "stick"]
    assert {path.name for path in sources(*stick)} == {"adhesion.py", "tool_contact.py"}


def test_a_changed_constant_of_another_file_is_not_missed(tmp_path: Path):
    # Python's own cache of byte code looks at times in whole seconds
    env = {"PYTHONPATH": f"{ROOT}:{tmp_path}", "PYTHONDONTWRITEBYTECODE": "1"}

    def run(origin: str, decorator: str, factor: float) -> list[float]:
        (tmp_path / "constants.py").write_text(f"FACTOR = {factor}\n")
        module = tmp_path / f"{origin.replace('.', '_')}.py"
        if not module.exists():
            module.write_text(KERNEL.format(origin=origin, decorator=decorator))
        code = f"import {module.stem} as m; print(m.scaled(2.0), sum(m.scaled.stats.cache_hits.values()))"
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True, check=True
        )
        return [float(word) for word in done.stdout.split()]

    for origin, decorator in (("plop.compute.cpu_kernels", "@kernel"), ("plop.physics.engine.jit", "@kernel()")):
        assert run(origin, decorator, 3.0) == [6.0, 0]
        assert run(origin, decorator, 3.0) == [6.0, 1]
        assert run(origin, decorator, 5.0) == [10.0, 0]
