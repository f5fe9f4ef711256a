"""Errors are for people: those of the missing-physics stages say what to do next, each of them."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
FOLDERS = (
    "plop/physics",
    "plop/diagnosis",
    "plop/sensors",
    "plop/reporting",
    "stages/augment",
    "stages/compare",
    "stages/diagnose",
    "stages/identify",
    "stages/report",
    "stages/simulate",
)


def without_fix(source: str) -> list[int]:
    """Lines that make an error which says nothing of what to do."""
    calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    made = [call for call in calls if getattr(call.func, "id", "") in ("PlopError", "UserCodeError")]
    return [call.lineno for call in made if all(word.arg != "fix" for word in call.keywords)]


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_error_says_what_to_do(folder):
    files = sorted((REPOSITORY / folder).rglob("*.py"))
    assert files
    silent = {path.name: lines for path in files if (lines := without_fix(path.read_text(encoding="utf-8")))}
    assert not silent


def test_an_error_that_does_not_is_found():
    assert without_fix("raise PlopError('No.', found='x')\nraise PlopError('No.', fix='Do.')\n") == [1]
