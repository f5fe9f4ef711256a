"""What every stage is: named inputs, a frozen configuration, one output, a summary.

A stage reads artifacts, writes one artifact and prints nothing. It does not know
where artifacts live, what they are called or who runs it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from plop.artifacts.manifest import Manifest
from plop.finite import UNKNOWN, json_ready, readable


@dataclass(frozen=True)
class InputSpec:
    """One named input of a stage."""

    stages: tuple[str, ...]
    """Names of the stages whose artifacts fit; empty for a raw file or folder given by the user."""
    help: str
    optional: bool = False
    only_named: bool = False
    """Optional, and taken only where the user names it: it would change a result that does not need it."""
    many: bool = False
    """Takes any number of artifacts, addresses with commas between; the stage finds them as `<name>.0`,
    `<name>.1`, ... in the order given."""
    along: str = ""
    """Another input whose recordings this one is made from; the command makes it when it is not there."""


@dataclass(frozen=True)
class Input:
    """One resolved input: a finished artifact, or a raw path."""

    path: Path
    """The payload's folder, or the raw file or folder."""
    manifest: Manifest | None = None
    """None for a raw path."""


Inputs = Mapping[str, Input]
"""Resolved inputs by name. An optional input that was not given is absent."""

Progress = Callable[..., None]
"""`progress(done, total, label="", **figures)`: called by a stage as often as it likes."""


def silent(done: float, total: float, label: str = "", **figures: Any) -> None:
    """Ignore progress."""


@dataclass(frozen=True)
class Output:
    """Where a stage writes.

    The folder is a scratch folder that belongs to this fingerprint alone. After a killed
    run the same folder comes back with what had been written: a stage keeps every finished
    piece (`is_done`, `mark_done`) and writes each file under a temporary name first.
    Everything visible in the folder at the end is the payload; hidden entries (`.done`,
    checkpoints in `.checkpoints`) and `*.tmp` files are dropped when the artifact is made.
    """

    path: Path
    progress: Progress = silent
    cache: Path | None = None
    """Folder that all runs of the stage share, for pieces named by everything that decides them; it may vanish between
    runs. None: pieces stay in the scratch folder."""

    def telling(self, progress: Progress) -> Output:
        """Give the same place; somebody else is told about progress."""
        return replace(self, progress=progress)

    def is_done(self, piece: str) -> bool:
        """Tell whether a piece of the work (an episode, say) was finished by an earlier, killed run."""
        return (self.path / ".done" / piece.replace("/", "_")).exists()

    def mark_done(self, piece: str) -> None:
        """Record that everything a piece writes is on the disk."""
        marks = self.path / ".done"
        marks.mkdir(exist_ok=True)
        (marks / piece.replace("/", "_")).touch()


@dataclass(frozen=True)
class Summary:
    """What a stage has to say, kept in the manifest and shown by the command."""

    figures: dict[str, Any] = field(default_factory=dict)
    """Named numbers with the unit in the name, e.g. {"episodes": 6, "depth_error_mm": 0.7}. JSON types only."""
    table: list[dict[str, Any]] = field(default_factory=list)
    """Rows to show, one dict a row, the same keys in each. JSON types only."""
    warnings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Keep no number that is none: it becomes null, and "unknown" in a text; a figure lost so is told."""
        figures: dict[str, Any] = json_ready(self.figures)
        lost = [key for key, value in figures.items() if value is None and self.figures[key] is not None]
        warnings = [readable(text) if isinstance(text, str) else text for text in self.warnings]
        if lost:
            warnings.append(f"{', '.join(lost)}: {UNKNOWN}, the result was not a finite number")
        table = [
            {key: readable(cell) if isinstance(cell, str) else cell for key, cell in row.items()}
            for row in json_ready(self.table)
        ]
        for name, value in (("figures", figures), ("table", table), ("warnings", warnings)):
            object.__setattr__(self, name, value)


Check = Callable[[Any, Mapping[str, "str | Path"]], None]
"""`check(config, given)`: refuses, with a PlopError, raw inputs that are wrong by themselves, and settings that only
other files can tell to be wrong, e.g. the name of an effect; all else is in the annotations of the settings."""


@dataclass(frozen=True)
class Stage:
    """One verb of the pipeline."""

    name: str
    """Name of the stage and of its folder under artifacts/, e.g. "fit-init"."""
    version: int
    """Bumped by hand when the same inputs and configuration would give another result."""
    help: str
    """One line for `plop --help`."""
    config: type
    """Frozen dataclass below `Settings` with a default for every field; annotations say ranges and units, a docstring
    under each field what it means."""
    inputs: Mapping[str, InputSpec]
    run: Callable[[Inputs, Any, Output], Summary]
    check: Check | None = None
    """Called before any input is made on the way, and before a dry run."""
    check_inputs: Callable[[Inputs, Any], None] | None = None
    """`check_inputs(inputs, config)`: refuse, with a PlopError, what the inputs that are there already tell, before
    others are made from them on the way, which may take minutes. Those that are made later are absent."""
    raw_files: Callable[[Path, Any], list[Path]] | None = None
    """`raw_files(folder, config)`: which files of a raw input are read, when not all of them. Only their
    contents enter the fingerprint, so that files of another environment beside them change nothing."""
    find_raw: Callable[[str, Path], Path] | None = None
    """`find_raw(input, path)`: the file that a raw input means, e.g. a shipped one by its bare name; it raises
    a PlopError when there is none. Without it the path itself."""
