"""Worker processes of this machine: the same for all that is done in parallel, since each takes seconds to start."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

_EVERY_S = 0.3


@contextmanager
def workers() -> Iterator[None]:
    """Let joblib's `Parallel` use them; other arguments than these would end them, and start new ones."""
    from joblib import parallel_config

    with parallel_config("loky", initializer=end_with_parent, initargs=(os.getpid(),)):
        yield


@cache
def end_with_parent(parent: int) -> None:
    """Let this process end when its parent is killed, or is dead already: its result is no longer needed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_EVERY_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
