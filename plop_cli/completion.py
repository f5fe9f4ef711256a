"""What the shell is told when it completes a command whose arguments are parsed later.

The front door knows stages by name only, so that it answers at once. A stage is imported for its options, and only when
an option is what is being completed; everything else is left to the shell, which then offers files.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperCommand


def completed_by(inner: Callable[[], typer.Typer], *, group: bool = False) -> type[TyperCommand]:
    """Make the class of a command that passes its arguments on.

    Args:
        inner: Gives the app that will parse them.
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
