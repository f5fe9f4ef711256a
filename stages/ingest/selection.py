"""Selection of episodes of a raw folder."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from plop.errors import PlopError
from plop.recordings.readers.side_file import RawEpisode, known_environments


def select(entries: Sequence[RawEpisode], *, environment: str, episodes: str, where: Path) -> list[RawEpisode]:
    """Choose the episodes of one environment.

    One whose JSON cannot be read, and whose name contains no environment of the others, may be of any: it is
    selected, so that reading it reports the error, instead of being left out silently.

    Args:
        entries: Everything in the folder.
        environment: Name of the environment; "" uses the only one.
        episodes: Glob over names.
        where: The folder, for messages.

    Raises:
        PlopError: Nothing matches, or several environments do.
    """
    known = known_environments(entries)
    if environment and environment not in known:
        raise PlopError(
            "There is no such environment.",
            where=where,
            expected=", ".join(known),
            found=environment,
            fix=f"Choose one, e.g. --environment {known[0]}.",
        )
    fitting = [e for e in entries if environment in ("", e.environment) or e.environment not in known]
    chosen = [entry for entry in fitting if fnmatchcase(entry.name, episodes)]
    if not chosen:
        raise PlopError(
            "No episode matches this name.",
            where=where,
            expected=f"names that match {episodes!r}",
            found=", ".join(entry.name for entry in fitting[:8]) + (" ..." if len(fitting) > 8 else ""),
            fix="Correct --episodes.",
        )
    found = sorted({entry.environment for entry in chosen} & set(known))
    if len(found) > 1:
        raise PlopError(
            "The folder contains several environments.",
            where=where,
            expected="one environment for each set of recordings",
            found=", ".join(found),
            fix=f"Choose one, e.g. --environment {found[0]}.",
        )
    return sorted(chosen, key=lambda entry: entry.name)
