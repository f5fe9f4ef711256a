"""A set of recordings: output of `ingest` and `calibrate`.

episodes/<name>.h5     one recording each
episodes.json          {"environment", "train": [names], "test": [names], "skipped": {name: reason}}
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from difflib import get_close_matches
from fnmatch import fnmatchcase
from pathlib import Path

from plop.artifacts.layouts import Recordings
from plop.errors import PlopError
from plop.recordings.recording import Recording


@dataclass(frozen=True)
class RecordingSet:
    """Names and split of the episodes in one folder."""

    folder: Path
    environment: str
    train: list[str]
    test: list[str]
    skipped: dict[str, str] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """All usable episodes, train first."""
        return [*self.train, *self.test]

    def path(self, name: str) -> Path:
        """Path of one episode's recording."""
        return Recordings(self.folder).episode(name)

    def open(self, name: str) -> Recording:
        """Open one episode; inside a run each is opened and checked once."""
        return Recording.open(self.path(name))

    def save(self) -> None:
        """Write episodes.json."""
        facts = asdict(self)
        del facts["folder"]
        Recordings(self.folder).index.write_text(json.dumps(facts, indent=1, sort_keys=True))

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> RecordingSet:
        """Read episodes.json of an artifact, or of its folder."""
        folder = Path(folder)
        path = Recordings(folder).index
        try:
            return cls(folder=folder, **json.loads(path.read_text()))
        except (OSError, ValueError, TypeError) as error:
            raise PlopError(
                "This is not a set of recordings.",
                where=path,
                expected="episodes.json of `plop ingest`",
                found=str(error),
                fix="Run `plop ingest` again.",
            ) from error


def split_names(names: list[str], test: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """Split episodes into train and test.

    Args:
        names: Names of all episodes.
        test: Globs of test episodes; empty selects the last quarter, at least one if there are two or more.

    Returns:
        Names for training, names for the test; both sorted.
    """
    names = sorted(names)
    if not test:
        kept = len(names) - max(len(names) // 4, 1) if len(names) > 1 else len(names)
        return names[:kept], names[kept:]
    held_out = [name for name in names if any(fnmatchcase(name, pattern) for pattern in test)]
    return [name for name in names if name not in held_out], held_out


def check_patterns(names: Sequence[str], patterns: Sequence[str], *, option: str, where: str | Path) -> list[str]:
    """Check that the user's patterns of episode names match episodes.

    Args:
        names: All episodes, including unusable ones.
        patterns: Globs, or plain names.
        option: The option with the patterns, for messages.
        where: The folder of the episodes, for messages.

    Returns:
        A warning for each glob without a match.

    Raises:
        PlopError: A plain name matches no episode; suggests similar ones.
    """
    warnings = []
    for pattern in patterns:
        if any(fnmatchcase(name, pattern) for name in names):
            continue
        if not set("*?[") & set(pattern):
            close = get_close_matches(pattern, names, n=3)
            raise PlopError(
                "There is no episode of this name.",
                where=where,
                found=f"{option} {pattern}",
                expected=", ".join(names[:8]) + (" ..." if len(names) > 8 else ""),
                fix=f"Did you mean {' or '.join(close)}?" if close else f"Correct {option}.",
            )
        warnings.append(f"{option} {pattern} matches no episode")
    return warnings
