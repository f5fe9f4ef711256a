"""Which episodes of a raw folder are taken."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from plop.errors import PlopError
from plop.recordings.readers.side_file import RawEpisode, known_environments


def select(entries: Sequence[RawEpisode], *, environment: str, episodes: str, where: Path) -> list[RawEpisode]:
    """Choose the episodes of one environment.

    One whose JSON cannot be read, and whose name tells no environment that the others have, may be of any: it is
    chosen, so that reading it tells what is wrong with it, rather than left out without a word.

    Args:
        entries: Everything in the folder.
        environment: Name of the environment; "" takes the only one there is.
        episodes: Glob over names.
        where: The folder, for messages.

    Raises:
        PlopError: Nothing fits, or several environments would.
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
            "No episode has such a name.",
            where=where,
            expected=f"names that fit {episodes!r}",
            found=", ".join(entry.name for entry in fitting[:8]) + (" ..." if len(fitting) > 8 else ""),
            fix="Correct --episodes.",
        )
    found = sorted({entry.environment for entry in chosen} & set(known))
    if len(found) > 1:
        raise PlopError(
            "The folder holds several environments.",
            where=where,
            expected="one environment for each set of recordings",
            found=", ".join(found),
            fix=f"Choose one, e.g. --environment {found[0]}.",
        )
    return sorted(chosen, key=lambda entry: entry.name)
