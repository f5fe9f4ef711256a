"""Every `plop` command that pages and messages write: the command is there, and so are its options."""

from __future__ import annotations

import ast
import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer

from plop_cli.app import app
from plop_cli.stage_command import stage_function
from stages import PIPELINE

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])


@cache
def options() -> dict[str, dict[str, bool]]:
    """Give command -> option -> whether it is a flag, which takes no value."""
    found = {}
    for ref in PIPELINE:
        own = typer.Typer()
        own.command()(stage_function(ref, ref.load()))
        found[ref.command] = _of(typer.main.get_command(own))
    root: Any = typer.main.get_command(app)
    found[""] = _of(root)
    return found | {name: _of(command) for name, command in root.commands.items() if name not in found}


def _of(command: Any) -> dict[str, bool]:
    named = [p for p in command.params if p.param_type_name == "option"]
    return {name: p.is_flag for p in named for name in (*p.opts, *p.secondary_opts)} | {"--help": True}


def written(page: Path) -> list[str]:
    """List code spans and the commands of code blocks; a line that ends in a backslash goes on."""
    text = page.read_text()
    blocks = re.findall(r"^```[^\n]*\n(.*?)^```", text, re.S | re.M)
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.S | re.M))
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [command for line in [*lines, *spans] for command in re.split(r";|&&", line)]


def faults(line: str) -> list[str]:
    """Name what is wrong with one line: commands that start with plop, or an option by itself."""
    line = line.strip().removeprefix("$ ").partition("  #")[0]
    if not line.startswith(("plop ", "--")):
        return []
    words = shlex.split(line.replace("'", "").split(" -> ")[0]) if line.count('"') % 2 == 0 else line.split()
    if words[:2] == ["plop", "run"] and len(words) > 2:  # takes what the stage's own command takes
        del words[1]
    if words[0] == "plop":
        name = next((name for n in (2, 1) if (name := " ".join(words[1 : 1 + n])) in options()), "")
        if not name:
            wrong = words[1].isidentifier() and words[1].islower() and words[1] != "ingest"  # <stage>, STAGE, --help
            return [f"no command {words[1]}"] if wrong else []
        known = options()[name]
    else:
        known = {option: flag for each in options().values() for option, flag in each.items()}
    return _wrong_options(words, known, strict=words[0] == "plop")


def _wrong_options(words: list[str], known: dict[str, bool], *, strict: bool) -> list[str]:
    wrong = []
    for word, following in zip(words, [*words[1:], ""], strict=True):
        option, given, _ = word.partition("=")
        if not re.fullmatch(r"--[a-z][a-z0-9.-]*", option):
            continue
        if option not in known:
            wrong += [f"no option {option}"] if strict else []
        elif known[option] and (given or following in ("true", "false")):
            wrong.append(f"{option} takes no value")
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_on_a_page_can_be_typed(page: Path) -> None:
    found = {line: wrong for line in written(page) if (wrong := faults(line))}
    assert not found


def advice(code: str) -> list[str]:
    """Give the texts of a module's strings, with {} for what is filled in."""
    return [_text(node) for node in ast.walk(ast.parse(code)) if isinstance(node, (ast.JoinedStr, ast.Constant))]


def _text(node: ast.AST) -> str:
    if isinstance(node, ast.JoinedStr):
        return "".join(_text(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return "{}"
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def unknown(text: str) -> list[str]:
    """Name what cannot be typed of the commands and options that a message tells."""
    commands = [span for span in re.findall(r"`(plop [^`]*)`", text) if not span.startswith("plop {}")]
    known = {option for each in options().values() for option in each}
    alone = re.findall(r"(?<![\w`-])--[a-z][a-z.-]*[a-z](?![\w{-])", re.sub(r"`[^`]*`", "", text))
    return [wrong for span in commands for wrong in faults(span)] + [option for option in alone if option not in known]


NOT_OURS = {"blender.py", "blender_scene.py", "results_file.py"}
"""Modules that write command lines of another program: Blender, git."""


@pytest.mark.parametrize("floor", ["plop", "stages", "plop_cli"])
def test_commands_in_messages_can_be_typed(floor: str) -> None:
    modules = [path for path in sorted((ROOT / floor).rglob("*.py")) if path.name not in NOT_OURS]
    found = {
        (path.name, text): wrong for path in modules for text in advice(path.read_text()) if (wrong := unknown(text))
    }
    assert not found


def test_wrong_messages_are_seen() -> None:
    (text,) = advice('f"Run `plop ingest --tset` of {x} or --raw, or `plop {x} --help`; -w and --set are fine"')[:1]
    assert unknown(text) == ["no option --tset", "--raw"]


def test_wrong_commands_are_seen() -> None:
    assert faults("plop ingest droid raw --rows.keep-skipped true") == ["--rows.keep-skipped takes no value"]
    assert faults("--rows.keep-skipped true") == ["--rows.keep-skipped takes no value"]
    assert faults("plop train --render.dpth 1") == ["no option --render.dpth"]
    assert faults("$ plop diagnose --modell base") == ["no option --modell"]
    assert faults("plop diagnoze --model base") == ["no command diagnoze"]
    assert faults("plop run diagnose --modell base") == ["no option --modell"]
    assert faults("plop run eval --modell base") == ["no option --modell"]
    assert faults("plop run melt") == ["no command melt"]
    assert not faults("plop run eval --model base")
    assert not faults("plop diagnose --model base --recordings mystery  # the verdict")
