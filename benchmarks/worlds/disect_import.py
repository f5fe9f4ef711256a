"""Import DiSECt from the folder where it was cloned; it was written for Python 3.8."""

from __future__ import annotations

import ast
import collections
import contextlib
import importlib
import importlib.util
import io
import sys
from collections.abc import MutableMapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, patch

from plop.errors import PlopError

_DISPLAY = ("PyQt5", "pandas", "pxr", "pyvista", "pyvistaqt", "seaborn", "sty", "urdfpy")
"""Imported by the simulator for displays, tables and robots only: stand-ins take their place when they are missing."""


def load(simulator: Path) -> Any:
    """Import the simulator from its folder; the first time it compiles its kernels there, which takes minutes.

    Raises:
        PlopError: The folder is no clone, or a package is not installed.
    """
    if not (simulator / "cutting" / "cutting_sim.py").is_file():
        raise PlopError(
            "The simulator is not in this folder.",
            where=simulator,
            expected="a clone of DiSECt, with cutting/cutting_sim.py",
            found="other files" if simulator.is_dir() else "no folder",
            fix="git clone https://github.com/NVlabs/DiSECt; its licence allows research only.",
        )
    vars(collections)["MutableMapping"] = MutableMapping  # where Python 3.9 and older had it
    for name in _DISPLAY:
        if name not in sys.modules and importlib.util.find_spec(name) is None:
            sys.modules[name] = MagicMock()
    if str(simulator.resolve()) not in sys.path:
        sys.path.insert(0, str(simulator.resolve()))
    try:
        importlib.import_module("torch")
        with contextlib.redirect_stdout(io.StringIO()):
            with patch.object(ast, "parse", _parsed_as_before):
                importlib.import_module("dflex")
            return importlib.import_module("cutting.cutting_sim")
    except ImportError as error:
        raise PlopError(
            "A package that the simulator needs is not installed.",
            where=simulator,
            expected="munch, tqdm and ninja, and Python 3.11",
            found=str(error),
            fix="pip install munch tqdm ninja",
        ) from error


def _parsed_as_before(source: str, _parse: Any = ast.parse) -> ast.Module:
    """Parse a kernel as Python 3.8 and older did, with a node around each index, which the simulator looks for."""
    tree = _parse(source)
    for node in list(ast.walk(tree)):
        if isinstance(node, ast.Subscript):
            node.slice = SimpleNamespace(value=node.slice)
    return tree
