"""A lock per fingerprint: of two runs that would make the same artifact, the second waits."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

POLL_S = 0.2


@contextmanager
def locked(path: Path, on_wait: Callable[[str], None] | None = None, *, note: Sequence[str] = ()) -> Iterator[None]:
    """Hold a lock file while the block runs; the system drops it when the process dies.

    Args:
        path: The lock file; made here and removed at the end.
        on_wait: Called once with the holder's process id when another run holds the lock.
        note: Lines that others can read while it is held, see `note_of`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = _acquire(path, on_wait)
    try:
        os.ftruncate(handle, 0)
        os.write(handle, "\n".join([str(os.getpid()), *note]).encode())
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def note_of(path: Path) -> list[str] | None:
    """Read what the holder of a lock wrote; None where nobody holds it."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return os.pread(handle, os.fstat(handle).st_size, 0).decode(errors="replace").split("\n")[1:]
    finally:
        os.close(handle)
    return None


def _acquire(path: Path, on_wait: Callable[[str], None] | None) -> int:
    told = False
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(handle, 32, 0).decode(errors="replace").partition("\n")[0]
            os.close(handle)
            if on_wait is not None and not told:
                on_wait(holder)
                told = True
            time.sleep(POLL_S)
            continue
        if _still_there(handle, path):
            return handle
        os.close(handle)  # the last holder removed the file between our open and our lock


def _still_there(handle: int, path: Path) -> bool:
    try:
        return os.fstat(handle).st_ino == path.stat().st_ino
    except FileNotFoundError:
        return False
