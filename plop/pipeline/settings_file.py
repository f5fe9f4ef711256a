"""Sources of overrides of settings: plop.toml in the workspace, and `--set`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from plop.artifacts.fingerprint import flat_values as flat_values
from plop.errors import PlopError
from plop.pipeline.settings import SETTINGS_FILE as SETTINGS_FILE
from plop.pipeline.settings import unknown_key


def read_settings_file(path: Path, commands: list[str]) -> dict[str, dict[str, Any]]:
    """Read plop.toml: one table per command (`[train]`, `[ingest.disect]`); flat overrides by command.

    Returns:
        Overrides by command; empty when there is no file.

    Raises:
        PlopError: The file is not TOML, or a table has no matching command.
    """
    if not path.is_file():
        return {}
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise PlopError(
            "The settings file cannot be read.",
            where=path,
            expected="TOML",
            found=str(error),
            fix="Correct that line; docs/how-to/change-settings.md shows such a file.",
        ) from error
    return settings_by_command(tables, commands, where=str(path))


def settings_by_command(tables: Mapping[str, Any], commands: list[str], *, where: str) -> dict[str, dict[str, Any]]:
    """Convert parsed TOML to flat overrides by command.

    Raises:
        PlopError: A table is of no command.
    """
    found: dict[str, dict[str, Any]] = {}
    for command, value in _flatten(tables, commands):
        if command not in commands:
            raise unknown_key(command, commands, where=where, owner=SETTINGS_FILE, lister="--help")
        if not isinstance(value, Mapping):
            raise PlopError(
                "Settings of a stage must be in a table.",
                where=where,
                expected=f"[{command.replace(' ', '.')}], and KEY = VALUE below it",
                found=f"{command} = {value!r}",
                fix="Write a table; `--help` of the command lists its settings.",
            )
        found[command] = dict(flat_values(value))
    return found


def _flatten(tables: Mapping[str, Any], commands: list[str]) -> list[tuple[str, Any]]:
    rows: list[tuple[str, Any]] = []
    groups = {command.split()[0] for command in commands if " " in command}
    for key, value in tables.items():
        if key in groups and isinstance(value, Mapping):
            rows += [(f"{key} {inner}", content) for inner, content in value.items()]
        else:
            rows.append((key, value))
    return rows


def parse_assignments(assignments: list[str], commands: list[str], own: str | None = None) -> dict[str, dict[str, str]]:
    """Parse `--set train.horizon=8`, and `--set horizon=8` for the command itself; flat overrides by command.

    Raises:
        PlopError: Not an assignment, or of an unknown command.
    """
    found: dict[str, dict[str, str]] = {}
    for text in assignments:
        key, equals, value = text.partition("=")
        if not equals:
            raise PlopError(
                "--set takes key=value.",
                where=text,
                found=text,
                expected="KEY=VALUE" if own else "STAGE.KEY=VALUE",
                fix=f"For example --set {own or 'train'}.seed=1.",
            )
        prefixes = {command.replace(" ", ".") + ".": command for command in commands}
        owner = next((prefix for prefix in prefixes if key.startswith(prefix)), None)
        if owner is None and own is None:
            stage, _, setting = key.rpartition(".")
            stages = [prefix.rstrip(".") for prefix in prefixes]
            close = get_close_matches(stage, stages, n=1)
            fix = f"Did you mean --set {close[0]}.{setting}={value}?" if close else "Write --set STAGE.KEY=VALUE."
            raise PlopError("--set needs the name of the stage.", where=text, expected=", ".join(stages), fix=fix)
        command = prefixes[owner] if owner is not None else str(own)
        found.setdefault(command, {})[key.removeprefix(owner or "").strip().replace("-", "_")] = value.strip()
    return found


def own_assignments(assignments: list[str], command: str, commands: list[str]) -> dict[str, str]:
    """Parse the `--set` options of one command.

    Raises:
        PlopError: One of them is the setting of another command.
    """
    found = parse_assignments(assignments, commands, command)
    for other in found.keys() - {command}:
        raise PlopError(
            f"--set names settings of `plop {other}`, which have no effect on `plop {command}`.",
            found=", ".join(found[other]),
            fix=f"Set them there, or in {SETTINGS_FILE}.",
        )
    return found.get(command, {})
