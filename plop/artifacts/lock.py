"""A lock per fingerprint: when two runs would make the same artifact, the second waits."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

POLL_S = 0.2


@contextmanager
def locked(path: Path, on_wait: Callable[[str], None] | None = None, *, note: Sequence[str] = ()) -> Iterator[None]:
    """Hold a lock file while the block runs; the system releases it when the process dies.

    Args:
        path: The lock file; made here and removed at the end.
        on_wait: Called once with the holder's process id when another run holds the lock.
        note: Lines that others can read while it is held, see `note_of`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = _lock(path, note)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        if on_wait is not None:
            on_wait(_lines(path)[0])
        lock.acquire()
    try:
        yield
    finally:
        _drop(lock, path)


def note_of(path: Path) -> list[str] | None:
    """Read the note of a lock's holder; None when the lock is free."""
    if not path.is_file():
        return None
    lock = _lock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return _lines(path)[1:]
    _drop(lock, path)
    return None


def _lock(path: Path, note: Sequence[str] = ()) -> FileLock:
    """Create a lock of the operating system, which is released when a process is killed; never a file-only lock."""

    def write(handle: int) -> None:
        os.ftruncate(handle, 0)  # left by a killed holder
        os.write(handle, "\n".join([str(os.getpid()), *note]).encode())

    return FileLock(path, mode=0o644, poll_interval=POLL_S, fallback_to_soft=False, on_acquired=write)


def _drop(lock: FileLock, path: Path) -> None:
    """Remove the file while it is held: a waiting process sees that it is gone, and creates a new one."""
    with suppress(OSError):  # Windows keeps a file that is open
        path.unlink()
    lock.release()


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(errors="replace").split("\n")
    except OSError:  # just removed; or Windows, which does not show what is locked
        return [""]
