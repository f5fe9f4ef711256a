"""What every stage is: named inputs, a frozen configuration, one output, a summary.

A stage reads artifacts, writes one artifact and prints nothing. It does not know
where artifacts live, what they are called or who runs it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plop.artifacts.atomic_file import write_text
from plop.artifacts.manifest import Manifest
from plop.finite import UNKNOWN, json_ready, readable
from plop.pipeline.mapping import Mapped, Mapper, Progress, map_pieces, mark_of

if TYPE_CHECKING:
    from plop.artifacts.store import Artifact


class Choice(Enum):
    """How an input is found where the user names none."""

    LATEST = auto()
    """The latest that fits: of one line of descent with the other inputs."""
    ANY_LINE = auto()
    """The latest, whatever the other inputs come from: a model meets recordings that it was not made from."""
    UNAMBIGUOUS = auto()
    """The latest, unless several could be meant: then the user is asked."""
    MADE = auto()
    """Made on the way by its recipe, with the settings of the workspace; what is there already is taken."""
    MATCHING = auto()
    """The latest that was made from the recipe's inputs, with whatever settings; made on the way when there is none."""
    NAMED = auto()
    """Not at all: it would change a result that does not need it."""


@dataclass(frozen=True)
class Origin:
    """The recordings that a model was made from; those of its base where effects were added to it."""

    model: str = "model"
    """Input that the model is."""
    input: str = "recordings"
    """Input of the stages that make models from recordings."""
    apart_from: str = ""
    """Left out where they are this input, or what it was made from."""


@dataclass(frozen=True)
class Recipe:
    """How an input is made on the way: by the first of its stages, from other inputs of the stage that needs it."""

    inputs: Mapping[str, str | Origin]
    """Input of the making stage -> input of this one. Its other inputs are made by their own recipes, or left out."""
    settings: Callable[[Any], Mapping[str, Any]] | None = None
    """`settings(config)`: settings of the making stage that follow from those of this one; they win over plop.toml."""
    defaults: Callable[[Mapping[str, Artifact]], tuple[Mapping[str, Any], str]] | None = None
    """`defaults(inputs)`: settings that follow from the making stage's inputs where plop.toml has none, and why."""
    needed: Callable[[Any, Inputs], bool] | None = None
    """`needed(config, inputs)`: whether the input is needed at all, by the settings and the inputs that are there."""
    makes: bool = True
    """False: only what is there already is taken."""


@dataclass(frozen=True)
class InputSpec:
    """One named input of a stage: who makes it, and how it is found or made where the user names none.

    These declarations are the whole graph: `plop.pipeline.graph` reads chains, what is made on the way and what comes
    next from them.
    """

    stages: tuple[str, ...]
    """Names of the stages whose artifacts fit, the usual one first; empty for a raw file or folder given by the
    user."""
    help: str
    optional: bool = False
    choice: Choice | Origin = Choice.LATEST
    """How it is found."""
    many: bool = False
    """Takes any number of artifacts, addresses with commas between; the stage finds them as `<name>.0`,
    `<name>.1`, ... in the order given."""
    recipe: Recipe | None = None
    """How it is made when it is not there; None: by the user alone."""
    read: bool = True
    """False: not read by the stage; other inputs are made from it."""
    select: Callable[[Any, Sequence[Artifact], Mapping[str, Sequence[Artifact]]], Sequence[Artifact]] | None = None
    """`select(config, found, inputs)`: which of those that match count (`Choice.MATCHING`), the latest last."""


@dataclass(frozen=True)
class Input:
    """One resolved input: a finished artifact, or a raw path."""

    path: Path
    """The payload's folder, or the raw file or folder."""
    manifest: Manifest | None = None
    """None for a raw path."""


Inputs = Mapping[str, Input]
"""Resolved inputs by name. An optional input that was not given is absent."""


def silent(done: float, total: float, label: str = "", **figures: Any) -> None:
    """Ignore progress."""


@dataclass(frozen=True)
class Output:
    """Where a stage writes.

    The folder is a scratch folder that belongs to this fingerprint alone. After a killed
    run the same folder comes back with what had been written: `map` carries out only the pieces
    that are left. Each file is written under a temporary name first.
    Everything visible in the folder at the end is the payload; hidden entries (`.done`,
    checkpoints in `.checkpoints`) and `*.tmp` files are dropped when the artifact is made.
    """

    path: Path
    progress: Progress = silent
    cache: Path | None = None
    """Folder that all runs of the stage share, for pieces named by everything that decides them; it may vanish between
    runs. None: pieces stay in the scratch folder."""
    mapper: Mapper | None = None
    """Carries out the pieces of `map`; processes of this machine when None."""

    def map(
        self,
        pieces: Sequence[str],
        work: Callable[[str, Output], Any],
        *,
        jobs: int = -1,
        of: str = "",
        keep_going: bool = False,
    ) -> Mapped:
        """Carry out pieces of the work, episodes say, in any order and several at a time; see `map_pieces`.

        Args:
            pieces: Their names.
            work: `work(name, out)` carries out one and gives what is to be known of it, in JSON types: this is kept,
                and a run that goes on after a kill reads it. Progress counts from 0 to `total` of that piece. It can
                be pickled: a function of a module, perhaps `partial`.
            jobs: Processes; -1 is one a core, as far as the memory goes.
            of: What the pieces are, where a stage has several kinds.
            keep_going: A piece that raises a PlopError does not stop the others.

        Returns:
            Values and errors by name, in the order of the names.

        Raises:
            PlopError: The first that a piece raised, unless `keep_going`.
        """
        there = replace(self, progress=silent, mapper=None)  # what reports or maps here need not reach another process
        return map_pieces(
            partial(_work_on_piece, work, there),
            pieces,
            self.path,
            self.progress,
            jobs=jobs,
            mapper=self.mapper,
            of=of,
            keep_going=keep_going,
        )

    def is_done(self, piece: str) -> bool:
        """Tell whether a piece of the work was finished by an earlier, killed run."""
        return mark_of(self.path, piece).exists()

    def mark_done(self, piece: str, value: Any = None) -> None:
        """Record that everything a piece writes is on the disk, and what is to be known of it (JSON types)."""
        write_text(mark_of(self.path, piece), json.dumps(value))


def _work_on_piece(work: Callable[[str, Output], Any], out: Output, name: str, progress: Progress) -> Any:
    return work(name, replace(out, progress=progress))


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
    complete: Callable[[Any, Mapping[str, str | Path]], Any] | None = None
    """`complete(config, given)`: settings with what follows from how the user wrote the inputs."""
    find_raw: Callable[[str, Path], Path] | None = None
    """`find_raw(input, path)`: the file that a raw input means, e.g. a shipped one by its bare name; it raises
    a PlopError when there is none. Without it the path itself."""
