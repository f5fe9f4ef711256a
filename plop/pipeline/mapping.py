"""Work on the pieces of a stage, an episode each: side by side where wanted, kept across a kill, results in order.

One episode seldom keeps two cores busy: its images are small, and its frames wait for each other.
"""

from __future__ import annotations

import json
import os
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from plop.artifacts.atomic_file import write_text
from plop.compute.memory import available_bytes
from plop.errors import PlopError
from plop.recordings.opened_once import opened_once

# Where one piece fails, the others are stopped: joblib warns of that, and the error says it better. It also warns where
# it starts a process afresh because that has grown, and goes on.
for _text in (r"\d+ tasks (which were still|have been successfully)", "A worker stopped while some jobs were given"):
    warnings.filterwarnings("ignore", message=_text, category=UserWarning)

PROCESS_BYTES = 1_000_000_000
"""Memory that is left for each process where their number is not given: torch, and the frames of an episode."""
_EVERY_S = 0.3
"""How often progress is passed on [s]."""

Progress = Callable[..., None]
"""`progress(done, total, label="", **figures)`."""
Work = Callable[[str, Progress], Any]
"""`work(name, progress)` carries out a piece and gives what is to be known of it, in JSON types; its progress counts
from 0 to `total` of that piece."""


@dataclass(frozen=True)
class Piece:
    """One piece that was carried out."""

    name: str
    value: Any = None
    """What its work gave, as read from JSON."""
    error: PlopError | None = None
    """Why it could not be carried out."""


class Mapper(Protocol):
    """Carries out tasks somewhere: in processes of this machine, on a cluster that sees the same files."""

    def __call__(self, task: Callable[[str], Piece], names: Sequence[str], jobs: int, /) -> Iterable[Piece]:
        """Call `task`, which can be pickled, with every name; give what it returns, in any order.

        A task may be carried out again when its worker was lost. `jobs` is the user's wish, -1 for as many as there
        are cores; there are no workers of this machine to count where a cluster has its own.
        """
        ...


@dataclass(frozen=True)
class Mapped:
    """What became of all pieces, each in the order of their names, whatever the number of processes."""

    values: dict[str, Any]
    """What the work gave, of those that were carried out."""
    errors: dict[str, PlopError]
    """Why the others were not."""


def map_pieces(
    work: Work,
    names: Sequence[str],
    folder: Path,
    progress: Progress,
    *,
    jobs: int = -1,
    mapper: Mapper | None = None,
    of: str = "",
    keep_going: bool = False,
) -> Mapped:
    """Carry out the pieces that are not done yet, and keep what each gives.

    Args:
        work: Can be pickled where there are several processes.
        names: Of all pieces, each once.
        folder: Scratch folder of the run, which holds what an earlier, killed run has finished.
        progress: Called as the work goes on.
        jobs: Processes; -1 is one a core, as far as the memory goes. With 1 (or one piece) everything happens in this
            one, on all its threads.
        mapper: Carries the pieces out; processes of this machine when None.
        of: What the pieces are, where a stage has several kinds; their marks begin with it.
        keep_going: A piece that raises a PlopError does not stop the others. It is not done: the next run tries again.

    Returns:
        Values and errors in the order of the names.

    Raises:
        PlopError: The first that a piece raised, unless `keep_going`; those finished before stay finished.
    """
    task = _Task(work, folder, f"{of}-" if of else "")
    found = {name: Piece(name, kept[0]) for name in names if (kept := task.kept(name))}
    for piece in _carried_out(task, names, len(found), [n for n in names if n not in found], progress, jobs, mapper):
        if piece.error is not None and not keep_going:
            raise piece.error
        found[piece.name] = piece
    ordered = [found[name] for name in names]
    return Mapped(
        {piece.name: piece.value for piece in ordered if piece.error is None},
        {piece.name: piece.error for piece in ordered if piece.error is not None},
    )


def mark_of(folder: Path, piece: str) -> Path:
    """Give the file in a scratch folder that says that a piece is done, and holds what is known of it."""
    return folder / ".done" / piece.replace("/", "_")


def processes(jobs: int, pieces: int) -> int:
    """Give the number of processes for so many pieces: -1 is one a core, as far as the memory goes."""
    from joblib import effective_n_jobs

    count: int = effective_n_jobs(jobs)
    free = available_bytes() if jobs < 0 else None
    if free is not None:
        count = min(count, free // PROCESS_BYTES)
    return max(1, min(count, pieces))


def in_processes(task: Callable[[str], Piece], names: Sequence[str], jobs: int, /) -> Iterator[Piece]:
    """Carry out tasks in processes of this machine, each on its share of the cores."""
    from joblib import Parallel, delayed, parallel_config

    with parallel_config("loky", initializer=_end_with_parent, initargs=(os.getpid(),)):
        parallel = Parallel(n_jobs=processes(jobs, len(names)), return_as="generator_unordered")
    return iter(parallel(delayed(_in_child)(task, os.getpid(), os.getcwd(), name) for name in names))


def _carried_out(
    task: _Task,
    names: Sequence[str],
    done: int,
    left: Sequence[str],
    progress: Progress,
    jobs: int,
    mapper: Mapper | None,
) -> Iterator[Piece]:
    if mapper is None and processes(jobs, len(left)) == 1:
        for place, name in enumerate(left, start=done):
            yield task.carried_out(name, _shifted(progress, place, len(names), name))
    elif mapper is not None:
        for place, piece in enumerate(mapper(task, left, jobs), start=done + 1):
            progress(place, len(names), piece.name)
            yield piece
    elif left:
        with _gathered(progress, done, len(names)) as notes:
            yield from in_processes(replace(task, notes=notes), left, jobs)


@dataclass(frozen=True)
class _Task:
    """Carries out one piece in whatever process it lands in."""

    work: Work
    folder: Path
    prefix: str
    notes: Path | None = None
    """Folder in which a piece writes how far it is; gone when nobody reads it any more."""

    def __call__(self, name: str) -> Piece:
        last = 0.0

        def noted(part: float, whole: float, label: str = "", **figures: Any) -> None:
            nonlocal last
            if self.notes is not None and (time.monotonic() > last + _EVERY_S or part >= whole):
                last = time.monotonic()
                note = self.notes / f"{mark_of(self.folder, name).name}.json"
                with suppress(FileNotFoundError):  # the run that started this process was killed
                    note.with_suffix(".part").write_text(json.dumps([part / whole, label or name, figures]))
                    note.with_suffix(".part").replace(note)

        return self.carried_out(name, noted)

    def carried_out(self, name: str, progress: Progress) -> Piece:
        try:
            with opened_once():
                text = json.dumps(self.work(name, progress))
        except PlopError as error:
            return Piece(name, error=error)
        write_text(self.mark(name), text)
        progress(1, 1, name)
        return Piece(name, json.loads(text))  # as a run that goes on reads it: tuples are lists

    def mark(self, name: str) -> Path:
        return mark_of(self.folder, self.prefix + name)

    def kept(self, name: str) -> list[Any]:
        """Read what an earlier run kept of a piece: nothing, or one value."""
        try:
            return [json.loads(self.mark(name).read_text(encoding="utf-8"))]
        except (OSError, ValueError):
            return []


def _shifted(progress: Progress, done: float, total: int, name: str) -> Progress:
    """Count one piece's progress among all of them."""

    def shifted(part: float, whole: float, label: str = "", **figures: Any) -> None:
        progress(done + part / whole, total, label or name, **figures)

    return shifted


def _in_child(task: Callable[[str], Piece], parent: int, folder: str, name: str) -> Piece:
    _end_with_parent(parent)  # older versions of joblib call no initializer
    os.chdir(folder)  # a process that is used again is where its first caller was; raw data may have relative paths
    return task(name)


@cache
def _end_with_parent(parent: int) -> None:
    """Let this process end when the one that started it is killed, perhaps already: nobody waits for what it makes."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_EVERY_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _gathered(progress: Progress, done: int, total: int) -> Iterator[Path]:
    """Give a folder in which pieces write about their progress; what they write is added up and passed on.

    It is no part of the scratch folder: a process of a killed run, which lives a moment longer, may still write there.
    """
    stop = threading.Event()
    latest: dict[str, float] = {}
    parts: dict[str, float] = {}

    def gather(folder: Path) -> None:
        while not stop.wait(_EVERY_S):
            for note in folder.glob("*.json"):
                if latest.get(note.name) == note.stat().st_mtime:
                    continue
                latest[note.name] = note.stat().st_mtime
                parts[note.name], label, figures = json.loads(note.read_text(encoding="utf-8"))
                progress(done + sum(parts.values()), total, label, **figures)

    with TemporaryDirectory(prefix="plop-progress-", ignore_cleanup_errors=True) as folder:
        gatherer = threading.Thread(target=gather, args=(Path(folder),), daemon=True)
        gatherer.start()
        try:
            yield Path(folder)
        finally:
            stop.set()
            gatherer.join()
    progress(total, total)
