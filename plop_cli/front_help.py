"""The output of `plop --help`, without the library that draws boxes, which took half of the time."""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup

LONGEST = 200
"""Characters of a command's line; each has one sentence."""


class FrontDoor(TyperGroup):
    """All commands, by group."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write usage, description, options, and the commands by group, in the order in which they were added."""
        self.format_usage(ctx, formatter)
        self.format_help_text(ctx, formatter)
        options = [record for parameter in self.get_params(ctx) if (record := parameter.get_help_record(ctx))]
        with formatter.section("Options"):
            formatter.write_dl(options)
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, command in self.commands.items():
            panel = str(getattr(command, "rich_help_panel", ""))
            groups.setdefault(panel, []).append((name, command.get_short_help_str(LONGEST)))
        for panel, rows in groups.items():
            with formatter.section(panel):
                formatter.write_dl(rows)
