"""Invalidate numba's cache on disk when any source file of a kernel changes.

numba's cache checks only the file that holds a function, not the files of the functions and constants that it uses:
after an update it would use outdated code.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

_COMPUTE = Path(__file__).parent


@lru_cache
def sources_digest(folder: Path) -> str:
    """Hash all Python sources of a folder and those below it."""
    total = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        total.update(path.read_bytes())
    return total.hexdigest()


def watch_sources(dispatcher: Callable[..., Any], *folders: Path) -> Callable[..., Any]:
    """Make a kernel's cache key depend on every source file of its own folder, of `folders` and of `plop.compute`.

    A kernel may use functions and constants of these, and of no other folder.

    Args:
        dispatcher: Result of `numba.njit(cache=True)`.
        folders: Further folders.

    Returns:
        The dispatcher.
    """
    compiled: Any = dispatcher
    file = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if file is not None and hasattr(file, "_source_stamp"):
        own = Path(compiled.py_func.__code__.co_filename).parent
        file._source_stamp = (
            file._source_stamp,
            *(sources_digest(f) for f in dict.fromkeys((own, *folders, _COMPUTE))),
        )
    return dispatcher
