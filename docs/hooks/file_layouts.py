"""Layouts of files, from the code that reads and writes them: docstrings of modules, fields of results."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, get_args, get_type_hints

from markdown_parts import code, escaped, rows

DOCUMENTED = (
    "plop.recordings.recording",
    "plop.recordings.readers.mesh.sequence",
    "plop.gaussians.trajectory",
    "plop.render.view_file",
    "plop.models",
)
"""Modules whose docstring is the layout of a file."""
RESULTS = {
    "scores": "plop.metrics.scores.Scores",
    "compare": "plop.comparison.result.Comparison",
    "diagnosis": "plop.diagnosis.decision.result.Diagnosis",
    "plan": "plop.planning.result.Plan",
}
"""Files whose layout is a dataclass."""


def documented(module: str) -> str:
    """Return a module's docstring, its indented blocks as code."""
    text = inspect.getdoc(importlib.import_module(module)) or ""
    blocks, block = [], False
    for line in text.splitlines():
        indented = line.startswith("    ")
        if indented != block and (line or indented):
            blocks.append("```")
            block = indented
        blocks.append(line[4:] if indented else escaped(line))
    return "\n".join([*blocks, "```"] if block else blocks)


def result(place: str) -> str:
    """List the keys of a result file and of the objects in it, in a table each, and the values of enums."""
    from plop.pipeline.settings import field_docstrings

    module, _, name = place.rpartition(".")
    parts: list[str] = []
    for kind in _nested(getattr(importlib.import_module(module), name)):
        if issubclass(kind, Enum):
            parts.append(f"`{kind.__name__}`: {', '.join(code(each.value) for each in kind)}")
            continue
        hints, meanings = get_type_hints(kind), field_docstrings(kind)
        lines = [
            (code(each.name), code(_type(hints[each.name])), escaped(meanings.get(each.name, "")))
            for each in fields(kind)
        ]
        title = f"`{kind.FILE}`, schema {kind.SCHEMA}" if not parts else f"`{kind.__name__}`"
        parts.append(f"{title}: {escaped(inspect.getdoc(kind) or '')}\n\n{rows(['key', 'type', 'meaning'], lines)}")
    return "\n\n".join(parts)


def _nested(kind: Any) -> Iterator[Any]:
    """Give a dataclass, and each dataclass and enum among its fields once, in the order of first use."""
    found, todo = [], [kind]
    while todo:
        one = todo.pop(0)
        if one in found:
            continue
        if isinstance(one, type) and issubclass(one, Enum):
            found.append(one)
        elif is_dataclass(one):
            found.append(one)
            todo += [get_type_hints(one)[each.name] for each in fields(one)]
        else:
            todo += get_args(one)
    return iter(found)


def _type(hint: Any) -> str:
    """Write a type as JSON has it: lists and objects, names without their modules."""
    text = hint.__name__ if isinstance(hint, type) and not get_args(hint) else str(hint)
    text = re.sub(r"(?:\w+\.)+(\w+)", r"\1", text)
    for python, json in (("Mapping", "object"), ("dict", "object"), ("tuple", "list"), (", ...", ""), ("None", "null")):
        text = text.replace(python, json)
    return text


BLOCKS: dict[str, Callable[[], str]] = {
    **{name.rpartition(".")[2]: (lambda name=name: documented(name)) for name in DOCUMENTED},  # type: ignore[misc]
    **{f"{file}-json": (lambda place=place: result(place)) for file, place in RESULTS.items()},  # type: ignore[misc]
}
"""Name in `[[code NAME]]` -> what makes the block."""
