"""Locate errors in a user's effect file."""

from __future__ import annotations

import ast
import traceback
from pathlib import Path

from plop.errors import PlopError, UserCodeError


def user_error(path: Path, error: BaseException) -> PlopError:
    """Return a PlopError with the line of the user's file that raised an error."""
    line = next(
        (
            frame.lineno
            for frame in reversed(traceback.extract_tb(error.__traceback__))
            if Path(frame.filename).resolve() == path.resolve()
        ),
        getattr(error, "lineno", None),
    )
    return UserCodeError(
        "The effect file has an error.",
        where=f"{path}, line {line}" if line else str(path),
        found=f"{type(error).__name__}: {error}",
        fix="Correct that line and run again.",
    )


def line_of(kind: type, name: str, path: Path) -> int:
    """Find where a class, or a class of the same file that it derives from, sets a name.

    Args:
        kind: The class.
        name: Of a class variable or a method.
        path: The file.

    Returns:
        The line, counted from 1; the first line of the class, if nothing sets it.
    """
    bases = [base.__name__ for base in kind.__mro__ if base.__module__ == kind.__module__]
    classes = {node.name: node for node in ast.walk(ast.parse(path.read_bytes())) if isinstance(node, ast.ClassDef)}
    for node in (classes[base] for base in bases if base in classes):
        for statement in node.body:
            if name in _names(statement):
                return statement.lineno
    return classes[kind.__name__].lineno if kind.__name__ in classes else 1


def _names(statement: ast.stmt) -> list[str]:
    match statement:
        case ast.FunctionDef(name=name):
            return [name]
        case ast.Assign(targets=targets):
            return [target.id for target in targets if isinstance(target, ast.Name)]
        case ast.AnnAssign(target=ast.Name(id=name)):
            return [name]
    return []
