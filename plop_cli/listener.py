"""What the command line prints of the runs in a chain, and of those on the way to what was asked for."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from plop_cli.console import Console, format_seconds
from plop_cli.outcome import begins

if TYPE_CHECKING:
    from plop.pipeline.execute import Outcome, Plan
    from plop.pipeline.stage import Progress


class Chained:
    """A `plop.pipeline.listener.Listener` that prints one line of result for each run."""

    def __init__(self, console: Console, title: str = "") -> None:
        """Hold where to print, and what to write before each command, e.g. the environment."""
        self.console, self.title = console, title

    def warn(self, text: str) -> None:
        """Print a warning."""
        self.console.warn(text)

    def progress(self, command: str) -> AbstractContextManager[Progress]:
        """Show a bar."""
        return self.console.progress(self._titled(command))

    def waits(self, command: str, process: str) -> None:
        """Say who is waited for."""
        self.console.warn(f"another run (process {process}) is making {command}; waiting for it")

    def starts(self, plan: Plan) -> None:
        """Say what is going to run, and on what."""
        self.console.note(self._titled(begins(plan)))

    def finished(self, command: str, outcome: Outcome) -> None:
        """Print the warnings of a run, its address and how long it took."""
        self._warnings(command, outcome)
        state = "already there" if outcome.skipped else format_seconds(outcome.seconds)
        self.console.say(self._titled(f"{outcome.artifact.address}  {state}"))

    def _warnings(self, command: str, outcome: Outcome) -> None:
        for text in [] if outcome.skipped else outcome.warnings:
            self.console.warn(f"{command}: {text}")

    def _titled(self, text: str) -> str:
        return f"{self.title} {text}".strip()


class OnTheWay(Chained):
    """Says what was made on the way to what was asked for; what was there already is no news."""

    def finished(self, command: str, outcome: Outcome) -> None:
        """Print what was made, and its warnings."""
        if not outcome.skipped:
            self.console.say(f"made {outcome.artifact.address} on the way")
        self._warnings(command, outcome)


class LastOne(Chained):
    """Says nothing of what was asked for itself: it is reported in full."""

    def finished(self, command: str, outcome: Outcome) -> None:
        """Leave it to the report."""
