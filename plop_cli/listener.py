"""Console output of the runs in a chain, and of runs that make missing inputs."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from plop_cli.console import Console, format_seconds
from plop_cli.outcome import begins

if TYPE_CHECKING:
    from plop.pipeline.execute import Outcome, Plan
    from plop.pipeline.mapping import Progress


class Chained:
    """A `plop.pipeline.listener.Listener` that prints one line of result for each run."""

    def __init__(self, console: Console, title: str = "") -> None:
        """Create the listener; `title` is printed before each command, e.g. the environment."""
        self.console, self.title = console, title

    def warn(self, text: str) -> None:
        """Print a warning."""
        self.console.warn(text)

    def progress(self, command: str) -> AbstractContextManager[Progress]:
        """Show a bar."""
        return self.console.progress(self._titled(command))

    def waits(self, command: str, process: str) -> None:
        """Print which process is waited for."""
        self.console.warn(f"another run (process {process}) is making {command}; waiting for it")

    def starts(self, plan: Plan) -> None:
        """Print what is going to run, and on which inputs."""
        self.console.note(self._titled(begins(plan)))

    def finished(self, command: str, outcome: Outcome) -> None:
        """Print the warnings of a run, its address and how long it took."""
        self._warnings(command, outcome)
        state = "exists already" if outcome.skipped else format_seconds(outcome.seconds)
        self.console.say(self._titled(f"{outcome.artifact.address}  {state}"))

    def _warnings(self, command: str, outcome: Outcome) -> None:
        for text in [] if outcome.skipped else outcome.warnings:
            self.console.warn(f"{command}: {text}")

    def _titled(self, text: str) -> str:
        return f"{self.title} {text}".strip()


class OnTheWay(Chained):
    """Prints the inputs that had to be made; existing ones are not mentioned."""

    def finished(self, command: str, outcome: Outcome) -> None:
        """Print what was made, and its warnings."""
        if not outcome.skipped:
            self.console.say(f"made the missing input {outcome.artifact.address}")
        self._warnings(command, outcome)


class LastOne(Chained):
    """Prints nothing about the requested run itself, which is reported in full."""

    def finished(self, command: str, outcome: Outcome) -> None:
        """Print nothing; the run is reported later."""
