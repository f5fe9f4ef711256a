"""Cache of open recordings: each is opened and checked once per run.

A training step reads one frame of each of its windows; opening and checking the file costs more than that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Protocol, TypeVar


class Closable(Protocol):
    """Protocol of a recording in this module."""

    def close_file(self) -> None:
        """Close its file."""


Opened = TypeVar("Opened", bound=Closable)

MOST_OPEN = 32
"""Largest number of unused recordings that stay open; HDF5 caches up to 1 MB of each camera's images."""

Key = tuple[Path, int, int, int]
"""Path and identity of a file: inode, size [bytes] and time of change [ns]."""


class OpenRecordings:
    """Recordings that stay open between uses, the least recently used ones closed when there are too many."""

    def __init__(self) -> None:
        self._open: dict[Key, Any] = {}
        self._users: dict[Key, int] = {}
        self._checked: set[Key] = set()

    def lend(self, path: Path, opened: Callable[..., Opened]) -> Opened:
        """Return the recording at a path; `opened(path, checked=..., on_close=...)` opens one."""
        key = _key(path)
        if key in self._open:
            recording: Opened = self._open.pop(key)
        else:
            recording = opened(path, checked=key in self._checked, on_close=lambda: self._give_back(key))
        self._open[key] = recording  # the last one is the most recently used
        self._checked.add(key)
        self._users[key] = self._users.get(key, 0) + 1
        return recording

    def _give_back(self, key: Key) -> None:
        self._users[key] -= 1
        idle = [each for each in self._open if not self._users[each]]
        for each in idle[: max(0, len(idle) - MOST_OPEN)]:
            self._open.pop(each).close_file()

    def close(self) -> None:
        """Close all of them."""
        for recording in self._open.values():
            recording.close_file()
        self._open.clear()


_current: ContextVar[OpenRecordings | None] = ContextVar("open_recordings", default=None)


@contextmanager
def share_open_recordings() -> Iterator[None]:
    """Let `Recording.open` return, inside the block and on this thread, the same recording for the same file.

    Blocks may be nested; the end of the outermost one closes the files.
    """
    if _current.get() is not None:
        yield
        return
    run = OpenRecordings()
    token = _current.set(run)
    try:
        yield
    finally:
        _current.reset(token)
        run.close()


def of_this_run() -> OpenRecordings | None:
    """Return the open recordings of the block around the caller; None outside of one."""
    return _current.get()


def _key(path: Path) -> Key:
    facts = path.stat()
    return path, facts.st_ino, facts.st_size, facts.st_mtime_ns
