"""Descriptions of settings for `--help` and for the reference of all stages."""

from __future__ import annotations

import enum
from typing import Any

from plop.pipeline.registry import pipeline
from plop.pipeline.settings import Setting, settings_of
from plop.setting_kinds import SAME_RESULT, describe

COLUMNS = ("Setting", "Type", "Default", "Unit", "Range or choices", "What it is")


def in_brackets(setting: Setting) -> str:
    """Return range or choices with the unit, and the default: `[1 or more frames; default 4]`."""
    return f"[{'; '.join(part for part in (_expected(setting), f'default {written(setting.default)}') if part)}]"


def written(value: Any) -> str:
    """Format a value as the command line accepts it."""
    if isinstance(value, (tuple, list)):
        return ",".join(map(written, value)) or "none"
    if isinstance(value, enum.Enum):
        return value.name.lower()
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value) if value not in (None, "") else "none"


def _expected(setting: Setting) -> str:
    return setting.kind.expected or setting.kind.unit


def settings_reference() -> dict[str, str]:
    """Describe the settings of every stage.

    Returns:
        Markdown by the stage's command: a table of the common settings, one of the others, and one of each group.
    """
    return {ref.command: markdown(ref.command, settings_of(ref.load().config)) for ref in pipeline()}


def markdown(command: str, settings: list[Setting]) -> str:
    """Describe the settings of one stage as tables, the common ones first."""
    table = command.replace(" ", ".")
    parts = [
        f"Set with `plop {command} --KEY VALUE`, `--set KEY=VALUE`, or below `[{table}]` in `plop.toml`; "
        f"the keys of a group also below `[{table}.GROUP]`. Settings marked * do not change results."
    ]
    for title, rows in sections(settings).items():
        parts.append(f"### {title}\n\n{_row(COLUMNS)}\n{_row(['---'] * len(COLUMNS))}\n" + "\n".join(map(_cells, rows)))
    return "\n\n".join(parts) + "\n"


def sections(settings: list[Setting]) -> dict[str, list[Setting]]:
    """Group settings by the title of their table, common ones first, groups last."""
    found: dict[str, list[Setting]] = {}
    for setting in sorted(settings, key=lambda one: (not one.common, bool(one.group))):
        found.setdefault(title_of(setting), []).append(setting)
    return found


def title_of(setting: Setting) -> str:
    """Return the title of a setting's table."""
    if setting.common:
        return "Common settings"
    return f"Settings {setting.key.rpartition('.')[0]}.*: {setting.group.rstrip('.')}" if setting.group else "Settings"


def _cells(setting: Setting) -> str:
    kind = setting.kind
    mark = " *" if SAME_RESULT in kind.marks else ""
    expected = " or ".join(f"`{word}`" for word in kind.choices) or kind.range.text()
    name = "choice" if kind.choices else describe(kind.type)
    spans = [
        part if k % 2 else part.replace("<", "&lt;").replace("*", r"\*")
        for k, part in enumerate(setting.help.split("`"))
    ]
    text = "`".join(spans)  # code in the docstring is code on the page, and needs no escapes
    return _row([f"`{setting.key}`{mark}", name, f"`{written(setting.default)}`", kind.unit, expected, text])


def _row(cells: tuple[str, ...] | list[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
