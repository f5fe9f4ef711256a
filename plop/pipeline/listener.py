"""Listeners to a chain of runs: the command line prints their events, Python callers may ignore them."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Protocol

from plop.pipeline.mapping import Progress
from plop.pipeline.stage import silent

if TYPE_CHECKING:
    from plop.pipeline.execute import Outcome, Plan


class Listener(Protocol):
    """Receives the events of each run."""

    def warn(self, text: str) -> None:
        """Receive a note for the user."""

    def progress(self, command: str) -> AbstractContextManager[Progress]:
        """Return the progress callback of one run."""

    def waits(self, command: str, process: str) -> None:
        """Receive that another process is making the artifact."""

    def starts(self, plan: Plan) -> None:
        """Receive the plan of a run that is about to start."""

    def finished(self, command: str, outcome: Outcome) -> None:
        """Receive the outcome of a run, or that its artifact existed."""


class Silent:
    """A `Listener` that ignores everything."""

    def warn(self, text: str) -> None:
        """Ignore the event."""

    def progress(self, command: str) -> AbstractContextManager[Progress]:
        """Return a progress callback that does nothing."""
        return nullcontext(silent)

    def waits(self, command: str, process: str) -> None:
        """Ignore the event."""

    def starts(self, plan: Plan) -> None:
        """Ignore the event."""

    def finished(self, command: str, outcome: Outcome) -> None:
        """Ignore the event."""
