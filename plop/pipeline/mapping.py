"""Map work over the pieces of a stage, e.g. its episodes: in parallel on request, resumable, with ordered results.

One episode rarely keeps two cores busy: its images are small, and its frames are sequential.
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
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from plop.artifacts.atomic_file import write_text
from plop.compute.memory import available_bytes
from plop.compute.workers import end_with_parent, workers
from plop.errors import PlopError
from plop.recordings.open_recordings import share_open_recordings

# Where one piece fails, the others are stopped: joblib warns of that, and the error is clearer. It also warns when
# it restarts a process because its memory has grown.
for _text in (r"\d+ tasks (which were still|have been successfully)", "A worker stopped while some jobs were given"):
    warnings.filterwarnings("ignore", message=_text, category=UserWarning)

PROCESS_BYTES = 1_000_000_000
"""Memory per process where their number is not given: torch, and the frames of an episode."""
_EVERY_S = 0.3
"""Interval between progress reports [s]."""

Progress = Callable[..., None]
"""`progress(done, total, label="", **figures)`."""
Work = Callable[[str, Progress], Any]
"""`work(name, progress)` does a piece and returns its result in JSON types; its progress counts from 0 to `total` of
that piece."""


@dataclass(frozen=True)
class Piece:
    """One finished piece."""

    name: str
    value: Any = None
    """Result of its work, as read from JSON."""
    error: PlopError | None = None
    """Why it failed."""


class Mapper(Protocol):
    """Runs tasks: in processes of this machine, or on a cluster that sees the same files."""

    def __call__(self, task: Callable[[str], Piece], names: Sequence[str], jobs: int, /) -> Iterable[Piece]:
        """Call `task`, which can be pickled, with every name; yield its results, in any order.

        A task may run again when its worker is lost. `jobs` is the requested number of processes, -1 for one per
        core; it is ignored by a cluster with its own workers.
        """
        ...


@dataclass(frozen=True)
class Mapped:
    """Results of all pieces, in the order of their names, independent of the number of processes."""

    values: dict[str, Any]
    """Results of the finished pieces."""
    errors: dict[str, PlopError]
    """Errors of the others."""


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
    """Run the pieces that are not done yet, and store the result of each.

    Args:
        work: The work; can be pickled where there are several processes.
        names: Names of all pieces, without duplicates.
        folder: Scratch folder of the run, with the finished pieces of an earlier, killed run.
        progress: Called as the work advances.
        jobs: Number of processes; -1 is one per core, limited by memory. With 1 (or one piece) the work is done in
            this process, on all its threads.
        mapper: Runs the pieces; processes of this machine when None.
        of: Kind of the pieces, where a stage has several; prefix of their marks.
        keep_going: A piece that raises a PlopError does not stop the others. The next run tries it again.

    Returns:
        Values and errors in the order of the names.

    Raises:
        PlopError: The first that a piece raised, unless `keep_going`; finished pieces are kept.
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
    """Return the file in a scratch folder that marks a piece as done and stores its result."""
    return folder / ".done" / piece.replace("/", "_")


def processes(jobs: int, pieces: int) -> int:
    """Return the number of processes for a number of pieces: -1 is one per core, limited by memory."""
    from joblib import effective_n_jobs

    count: int = effective_n_jobs(jobs)
    free = available_bytes() if jobs < 0 else None
    if free is not None:
        count = min(count, free // PROCESS_BYTES)
    return max(1, min(count, pieces))


def in_processes(task: Callable[[str], Piece], names: Sequence[str], jobs: int, /) -> Iterator[Piece]:
    """Run tasks in processes of this machine, each on its share of the cores."""
    from joblib import Parallel, delayed

    with workers():
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
    """Runs one piece in any process."""

    work: Work
    folder: Path
    prefix: str
    notes: Path | None = None
    """Folder for the progress of a piece; removed when it is no longer read."""

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
            with share_open_recordings():
                text = json.dumps(self.work(name, progress))
        except PlopError as error:
            return Piece(name, error=error)
        write_text(self.mark(name), text)
        progress(1, 1, name)
        return Piece(name, json.loads(text))  # as a resumed run reads it: tuples are lists

    def mark(self, name: str) -> Path:
        return mark_of(self.folder, self.prefix + name)

    def kept(self, name: str) -> list[Any]:
        """Read the stored result of a piece: nothing, or one value."""
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
    end_with_parent(parent)  # older versions of joblib call no initializer
    os.chdir(folder)  # a reused process is in the folder of its first caller; raw data may have relative paths
    return task(name)


@contextmanager
def _gathered(progress: Progress, done: int, total: int) -> Iterator[Path]:
    """Yield a folder in which pieces write their progress; the sum is passed on.

    It is outside the scratch folder: a process of a killed run, which ends a moment later, may still write there.
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
