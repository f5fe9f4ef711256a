"""Definition of a stage: named inputs, a frozen configuration, one output, a summary.

A stage reads artifacts, writes one artifact and prints nothing. It does not know
where artifacts are stored, their names, or the process that runs it.
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
    """How an input is chosen when the user names none."""

    LATEST = auto()
    """The latest of the same lineage as the other inputs."""
    ANY_LINE = auto()
    """The latest, independent of the lineage of the other inputs: a model may be applied to new recordings."""
    UNAMBIGUOUS = auto()
    """The latest, unless it is ambiguous: then the user must choose."""
    MADE = auto()
    """Made by its recipe with the settings of the workspace; an existing artifact is reused."""
    MATCHING = auto()
    """The latest that was made from the recipe's inputs, with any settings; made when there is none."""
    NAMED = auto()
    """None, unless its recipe says that it is needed: it would change a result that does not need it."""


@dataclass(frozen=True)
class Origin:
    """The recordings that a model was made from; those of its base where effects were added to it."""

    model: str = "model"
    """Input that holds the model."""
    input: str = "recordings"
    """Input of the stages that make models from recordings."""
    apart_from: str = ""
    """Left out where they are this input, or one of its ancestors."""


@dataclass(frozen=True)
class Recipe:
    """How a missing input is made: by the first of its stages, from other inputs of the stage that needs it."""

    inputs: Mapping[str, str | Origin]
    """Input of the producing stage -> input of this one. Other inputs are made by their own recipes, or left out."""
    settings: Callable[[Any], Mapping[str, Any]] | None = None
    """`settings(config)`: settings of the producing stage that follow from this one's; they override plop.toml."""
    defaults: Callable[[Mapping[str, Artifact]], tuple[Mapping[str, Any], str]] | None = None
    """`defaults(inputs)`: settings that follow from its inputs where plop.toml has none, and the reason."""
    needed: Callable[[Any, Inputs], bool] | None = None
    """`needed(config, inputs)`: whether the input is needed, given the settings and the existing inputs."""
    makes: bool = True
    """False: only an existing artifact is used."""


@dataclass(frozen=True)
class InputSpec:
    """One named input of a stage: its producer, and how it is found or made when the user names none.

    These declarations define the whole graph: `plop.pipeline.graph` derives chains, missing inputs and next steps
    from them.
    """

    stages: tuple[str, ...]
    """Names of the stages whose artifacts are accepted, the default one first; empty for a raw file or folder given by
    the user."""
    help: str
    optional: bool = False
    choice: Choice | Origin = Choice.LATEST
    """How it is found."""
    many: bool = False
    """Accepts any number of artifacts, addresses separated by commas; the stage receives them as `<name>.0`,
    `<name>.1`, ... in the order given."""
    recipe: Recipe | None = None
    """How it is made when it is missing; None: only by the user."""
    read: bool = True
    """False: not read by the stage; other inputs are made from it."""
    select: Callable[[Any, Sequence[Artifact], Mapping[str, Sequence[Artifact]]], Sequence[Artifact]] | None = None
    """`select(config, found, inputs)`: selects among the matching ones (`Choice.MATCHING`), the latest last."""


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
    """The output folder of a stage.

    The folder is a scratch folder that belongs to this fingerprint only. After a killed
    run the same folder is used again with its files: `map` runs only the remaining pieces. Each file is written under
    a temporary name first. Everything visible in the folder at the end is the payload; hidden entries (`.done`,
    checkpoints in `.checkpoints`) and `*.tmp` files are discarded when the artifact is made.
    """

    path: Path
    progress: Progress = silent
    cache: Path | None = None
    """Cache folder that all runs of the stage share, for pieces named by everything that determines them; it may be
    removed between runs. None: pieces stay in the scratch folder."""
    mapper: Mapper | None = None
    """Runs the pieces of `map`; processes of this machine when None."""

    def map(
        self,
        pieces: Sequence[str],
        work: Callable[[str, Output], Any],
        *,
        jobs: int = -1,
        of: str = "",
        keep_going: bool = False,
    ) -> Mapped:
        """Run pieces of the work, e.g. episodes, in any order and in parallel; see `map_pieces`.

        Args:
            pieces: Their names.
            work: `work(name, out)` runs one piece and returns its result in JSON types, which is stored and read by
                a resumed run. Progress counts from 0 to `total` of that piece. It can be pickled: a function of a
                module, or a `partial` of one.
            jobs: Number of processes; -1 is one per core, limited by memory.
            of: Kind of the pieces, where a stage has several.
            keep_going: A piece that raises a PlopError does not stop the others.

        Returns:
            Values and errors by name, in the order of the names.

        Raises:
            PlopError: The first that a piece raised, unless `keep_going`.
        """
        # progress and mapper of this process are not sent to another one
        there = replace(self, progress=silent, mapper=None)
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
        """Return whether a piece of the work was finished by an earlier, killed run."""
        return mark_of(self.path, piece).exists()

    def mark_done(self, piece: str, value: Any = None) -> None:
        """Mark a piece as done, with all its files on the disk, and store its result (JSON types)."""
        write_text(mark_of(self.path, piece), json.dumps(value))


def _work_on_piece(work: Callable[[str, Output], Any], out: Output, name: str, progress: Progress) -> Any:
    return work(name, replace(out, progress=progress))


@dataclass(frozen=True)
class Summary:
    """Summary of a stage, stored in the manifest and shown by the command."""

    figures: dict[str, Any] = field(default_factory=dict)
    """Named numbers with the unit in the name, e.g. {"episodes": 6, "depth_error_mm": 0.7}. JSON types only."""
    table: list[dict[str, Any]] = field(default_factory=list)
    """Rows to show, one dict per row, the same keys in each. JSON types only."""
    warnings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Replace non-finite numbers by null, and by "unknown" in texts; warn of each figure lost."""
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
"""`check(config, given)`: rejects, with a PlopError, invalid raw inputs, and settings whose validity depends on other
files, e.g. the name of an effect; everything else is in the annotations of the settings."""


@dataclass(frozen=True)
class Stage:
    """One stage of the pipeline."""

    name: str
    """Name of the stage and of its folder under artifacts/, e.g. "fit-init"."""
    version: int
    """Increased by hand when the same inputs and configuration would give a different result."""
    help: str
    """One line for `plop --help`."""
    config: type
    """Frozen dataclass derived from `Settings` with a default for every field; annotations give ranges and units, a
    docstring under each field its meaning."""
    inputs: Mapping[str, InputSpec]
    run: Callable[[Inputs, Any, Output], Summary]
    check: Check | None = None
    """Called before any missing input is made, and before a dry run."""
    check_inputs: Callable[[Inputs, Any], None] | None = None
    """`check_inputs(inputs, config)`: reject, with a PlopError, unsuitable existing inputs, before others are made from
    them, which may take minutes. Those that are made later are absent."""
    raw_files: Callable[[Path, Any], list[Path]] | None = None
    """`raw_files(folder, config)`: which files of a raw input are read, when not all of them. Only their
    contents enter the fingerprint, so that files of another environment beside them do not change it."""
    complete: Callable[[Any, Mapping[str, str | Path]], Any] | None = None
    """`complete(config, given)`: settings completed by what follows from the spelling of the inputs."""
    find_raw: Callable[[str, Path], Path] | None = None
    """`find_raw(input, path)`: resolves the path of a raw input, e.g. a shipped file by its bare name; it raises
    a PlopError when there is none. None: the path itself."""
