"""Inputs that people really have, after public reports: a right result, or a refusal that names cause and fix."""

from __future__ import annotations

import importlib
import pkgutil
import shlex
from pathlib import Path

import pytest

import tests.cases
from plop_cli.app import main
from tests.cases.case import Case, Done

KINDS = sorted(
    module.name
    for module in pkgutil.iter_modules(tests.cases.__path__)
    if module.name.endswith("_cases") and not module.name.startswith("test_")
)
CASES: list[Case] = [case for kind in KINDS for case in importlib.import_module(f"tests.cases.{kind}").CASES]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_result_is_right_or_the_cause_is_named(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in case.needs:
        pytest.importorskip(module)
    case.make(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    codes, parts = [], []
    for command in case.commands:
        codes.append(main(shlex.split(command)))
        printed = capsys.readouterr()
        parts.append(" ".join((printed.out + " " + printed.err).split()))
        if codes[-1] != 0:
            break
    said = " ".join(parts)
    expected = [0] * (len(case.commands) - 1) + [1 if case.refused else 0]
    assert codes == expected, said
    assert [word for word in case.refused if word.lower() not in parts[-1].lower()] == [], said
    assert [word for word in case.warned if word.lower() not in said.lower()] == [], said
    assert [word for word in case.never if word.lower() in said.lower()] == [], said
    if case.right is not None:
        case.right(Done(tmp_path, codes, said))
