"""One input as people really have it: how it is made, what is run on it, and what a user may expect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from plop.artifacts.store import Store


@dataclass(frozen=True)
class Done:
    """What the commands of a case left behind."""

    workspace: Path
    codes: list[int]
    """Exit code of each command."""
    said: str
    """Everything printed, white space collapsed."""

    @property
    def store(self) -> Store:
        """The workspace's artifacts."""
        return Store(self.workspace)


@dataclass(frozen=True)
class Case:
    """One input and what is right for it.

    With `refused` the last command ends with exit code 1 and the ones before with 0; without it all end with 0.
    """

    name: str
    source: str
    """The public report it follows."""
    make: Callable[[Path], None]
    """`make(folder)`: writes the input below the folder, which is the workspace in which the commands run."""
    commands: tuple[str, ...]
    """Typed in this order, without "plop"."""
    refused: tuple[str, ...] = ()
    """Words (any case) that the last command's refusal holds: the cause, and the fix."""
    warned: tuple[str, ...] = ()
    """Words (any case) that stand in what the commands print, though they succeed."""
    never: tuple[str, ...] = ()
    """Words (any case) that must not be printed: another cause, another advice, nan."""
    right: Callable[[Done], None] | None = None
    """Asserts what the artifacts hold."""
    needs: tuple[str, ...] = field(default=())
    """Modules without which the case is skipped."""
