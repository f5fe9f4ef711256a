"""Who is told what a chain of runs does: the command line prints it, a caller from Python may not care."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Protocol

from plop.pipeline.mapping import Progress
from plop.pipeline.stage import silent

if TYPE_CHECKING:
    from plop.pipeline.execute import Outcome, Plan


class Listener(Protocol):
    """Hears of each run as it happens."""

    def warn(self, text: str) -> None:
        """Hear of something that the user should know."""

    def progress(self, command: str) -> AbstractContextManager[Progress]:
        """Give what is called as the work of one run goes on."""

    def waits(self, command: str, process: str) -> None:
        """Hear that another process is making what is wanted."""

    def starts(self, plan: Plan) -> None:
        """Hear what is going to run: it is not there already."""

    def finished(self, command: str, outcome: Outcome) -> None:
        """Hear what a run made, or that it was there."""


class Silent:
    """A `Listener` that ignores everything."""

    def warn(self, text: str) -> None:
        """Ignore it."""

    def progress(self, command: str) -> AbstractContextManager[Progress]:
        """Give a progress that ignores everything."""
        return nullcontext(silent)

    def waits(self, command: str, process: str) -> None:
        """Ignore it."""

    def starts(self, plan: Plan) -> None:
        """Ignore it."""

    def finished(self, command: str, outcome: Outcome) -> None:
        """Ignore it."""
