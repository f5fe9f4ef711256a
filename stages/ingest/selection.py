"""Which episodes of a raw folder are taken."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Protocol, TypeVar

from plop.errors import PlopError


class Entry(Protocol):
    """One raw episode, not read yet."""

    @property
    def name(self) -> str:
        """Name of the episode."""

    @property
    def environment(self) -> str:
        """Name of its environment."""

    @property
    def path(self) -> Path:
        """File that its reader opens."""


E = TypeVar("E", bound=Entry)


def select(entries: Sequence[E], *, environment: str, episodes: str, where: Path) -> list[E]:
    """Choose the episodes of one environment.

    Args:
        entries: Everything in the folder.
        environment: Name of the environment; "" takes the only one there is.
        episodes: Glob over names.
        where: The folder, for messages.

    Raises:
        PlopError: Nothing fits, or several environments would.
    """
    known = sorted({entry.environment for entry in entries})
    if environment and environment not in known:
        raise PlopError("There is no such environment.", where=where, expected=", ".join(known), found=environment,
                        fix=f"Choose one, e.g. --environment {known[0]}.")  # fmt: skip
    fitting = [entry for entry in entries if environment in ("", entry.environment)]
    chosen = [entry for entry in fitting if fnmatchcase(entry.name, episodes)]
    if not chosen:
        raise PlopError("No episode has such a name.", where=where, expected=f"names that fit {episodes!r}",
                        found=", ".join(entry.name for entry in fitting[:8]) + (" ..." if len(fitting) > 8 else ""),
                        fix="Correct --episodes.")  # fmt: skip
    found = sorted({entry.environment for entry in chosen})
    if len(found) > 1:
        raise PlopError("The folder holds several environments.", where=where,
                        expected="one environment for each set of recordings", found=", ".join(found),
                        fix=f"Choose one, e.g. --environment {found[0]}.")  # fmt: skip
    return sorted(chosen, key=lambda entry: entry.name)
