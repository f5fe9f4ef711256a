"""Keep numba's machine code on disk from outliving a change in any file that it came from.

numba's cache watches only the file that holds a function, not those of the functions and constants that it uses from
elsewhere: after an update it would go on with old parts.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Any


@lru_cache
def sources_digest(folder: Path) -> str:
    """Hash all Python sources of a folder and those below it."""
    total = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        total.update(path.read_bytes())
    return total.hexdigest()


def watch_sources(dispatcher: Any, *folders: Path) -> Any:
    """Make a cached kernel's stamp cover every source of its own folder and of `folders`.

    A kernel may use what these hold, and nothing from other folders.

    Args:
        dispatcher: What `numba.njit(cache=True)` gives.
        folders: Further folders.

    Returns:
        The dispatcher.
    """
    file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if file is not None and hasattr(file, "_source_stamp"):
        own = Path(dispatcher.py_func.__code__.co_filename).parent
        file._source_stamp = (file._source_stamp, *(sources_digest(f) for f in dict.fromkeys((own, *folders))))
    return dispatcher
