"""Shell completion of commands whose arguments are parsed later.

The command line knows stages by name only, so that it answers immediately. A stage is imported only when one of its
options is completed; everything else is left to the shell, which then offers files.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperCommand


def completed_by(inner: Callable[[], typer.Typer], *, group: bool = False) -> type[TyperCommand]:
    """Create the class of a command that passes its arguments on.

    Args:
        inner: Returns the app that will parse them.
        group: Whether that app has commands, whose names are completed, too.
    """

    class PassingCommand(TyperCommand):
        def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
            """Complete the name of a command, or an option."""
            if not (group or incomplete.startswith("-")):
                return []
            command: Any = typer.main.get_command(inner())
            words = list(ctx.args)
            if group and words:
                command, words = getattr(command, "commands", {}).get(words[0]), words[1:]
            if command is None:
                return []
            below = command.make_context(command.name, words, parent=ctx, resilient_parsing=True)
            return list(command.shell_complete(below, incomplete))

    return PassingCommand
