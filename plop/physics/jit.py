"""Compile kernels with numba so that the compiled code on disk never outlives a change in any file it came from."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
from numba import njit

numba.config.THREADING_LAYER = "omp"
"""Chosen, not probed: open3d brings an older TBB, and numba warns when it finds that one."""


@lru_cache
def _digest(folder: Path) -> str:
    """Hash all sources of one folder."""
    total = hashlib.sha256()
    for path in sorted(folder.glob("*.py")):
        total.update(path.read_bytes())
    return total.hexdigest()


_EFFECTS = Path(__file__).parent / "effects"
_SOURCES = _digest(Path(__file__).parent)


def kernel(*, parallel: bool = False) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Compile a function and keep the machine code between runs.

    numba's cache watches only the file that holds the function, not the files of the functions it calls:
    after an update it would go on with old parts. Here the stamp covers every file of the engine and, for
    the kernels of effects, every file of the effects too.

    Args:
        parallel: Whether `prange` loops may run in threads.
    """

    def compile_function(function: Callable[..., Any]) -> Callable[..., Any]:
        dispatcher = njit(parallel=parallel, fastmath=True, cache=True)(function)
        file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
        if file is not None and hasattr(file, "_source_stamp"):
            own = Path(function.__code__.co_filename).parent == _EFFECTS
            file._source_stamp = (*file._source_stamp, *([_digest(_EFFECTS)] if own else []), _SOURCES)
        return dispatcher

    return compile_function
