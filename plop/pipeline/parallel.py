"""Work on several episodes at a time, each in a process and on a thread of its own.

One episode seldom keeps two cores busy: its images are small, and its frames wait for each other.
"""

from __future__ import annotations

import json
import os
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol, Self, TypeVar

from joblib import Parallel, delayed, effective_n_jobs

from plop.artifacts.atomic_file import write_text
from plop.errors import PlopError

Progress = Callable[..., None]
"""`progress(done, total, label="", **figures)`."""


class Finishable(Protocol):
    """Where pieces are written, and who is told about progress: a stage's output."""

    @property
    def progress(self) -> Progress:
        """Who is told."""
        ...

    def telling(self, progress: Progress) -> Self:
        """The same place; somebody else is told."""
        ...

    def is_done(self, piece: str) -> bool:
        """Tell whether an earlier run finished a piece."""
        ...

    def mark_done(self, piece: str) -> None:
        """Record that a piece is whole."""
        ...


# Where one piece fails, the others are stopped: joblib warns of that, and the error says it better.
warnings.filterwarnings("ignore", message=r"\d+ tasks (which were still|have been successfully)", category=UserWarning)

Out = TypeVar("Out", bound=Finishable)
Work = Callable[[str, Out], None]
"""`work(name, out)`: carries out one piece; its progress counts from 0 to 1 of that piece."""
_EVERY_S = 0.3
"""How often progress is passed on [s]."""


def every_piece(work: Work[Out], names: Sequence[str], out: Out, *, jobs: int) -> None:
    """Carry out the pieces that are not done yet; see `each_piece`.

    Raises:
        PlopError: The first that a piece raised; those finished before stay finished.
    """
    for _, error in each_piece(work, names, out, jobs=jobs):
        if error is not None:
            raise error


def each_piece(work: Work[Out], names: Sequence[str], out: Out, *, jobs: int) -> Iterator[tuple[str, PlopError | None]]:
    """Carry out the pieces that are not done yet, and mark them done.

    Args:
        work: Can be pickled where there are several processes.
        names: Of all pieces.
        out: Where they are written, and who is told about progress.
        jobs: Processes; -1 is one a core. With 1 (or one piece) everything happens in this one, on all its threads.

    Yields:
        Each name with None, or the PlopError that its work raised: those done before first, then as they finish.
    """
    left = [name for name in names if not out.is_done(name)]
    yield from ((name, None) for name in names if name not in left)
    count = min(effective_n_jobs(jobs), len(left))
    if count <= 1:
        for name in left:
            done = len(names) - len(left) + left.index(name)
            yield name, _carried_out(work, name, out, _shifted(out.progress, done, len(names), name))
        return
    with _gathered(out.progress, len(names) - len(left), names) as folder:
        silent = out.telling(_nobody)
        tasks = (delayed(_in_process)(work, name, silent, folder / str(k)) for k, name in enumerate(left))
        yield from Parallel(n_jobs=count, return_as="generator_unordered")(tasks)


def _nobody(done: float, total: float, label: str = "", **figures: Any) -> None:
    """Tell nobody: what tells somebody does not reach another process."""


def _carried_out(work: Work[Out], name: str, out: Out, progress: Progress) -> PlopError | None:
    try:
        work(name, out.telling(progress))
    except PlopError as error:
        return error
    out.mark_done(name)
    progress(1, 1, name)
    return None


def _shifted(progress: Progress, done: float, total: int, name: str) -> Progress:
    """Count one piece's progress among all of them."""

    def told(part: float, whole: float, label: str = "", **figures: Any) -> None:
        progress(done + part / whole, total, label or name, **figures)

    return told


def _in_process(work: Work[Out], name: str, out: Out, notes: Path) -> tuple[str, PlopError | None]:
    """Carry out a piece where only a file tells others about its progress."""
    _end_with_parent()
    last = 0.0

    def told(part: float, whole: float, label: str = "", **figures: Any) -> None:
        nonlocal last
        if time.monotonic() > last + _EVERY_S or part >= whole:
            last = time.monotonic()
            write_text(notes, json.dumps([part / whole, label or name, figures]))

    return name, _carried_out(work, name, out, told)


@cache
def _end_with_parent() -> None:
    """Let this process end when the one that started it is killed: nobody waits for what it makes."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_EVERY_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _gathered(progress: Progress, done: int, names: Sequence[str]) -> Iterator[Path]:
    """Give a folder; what processes write about their progress there is added up and told."""
    stop = threading.Event()

    def tell(folder: Path) -> None:
        latest: dict[str, float] = {}
        while not stop.wait(_EVERY_S):
            for note in folder.glob("[0-9]*"):
                if note.suffix or latest.get(note.name) == note.stat().st_mtime:
                    continue
                latest[note.name] = note.stat().st_mtime
                parts[note.name], label, figures = json.loads(note.read_text())
                progress(done + sum(parts.values()), len(names), label, **figures)

    parts: dict[str, float] = {}
    with TemporaryDirectory(prefix="plop-progress-") as name:
        teller = threading.Thread(target=tell, args=(Path(name),), daemon=True)
        teller.start()
        try:
            yield Path(name)
        finally:
            stop.set()
            teller.join()
    progress(len(names), len(names))
