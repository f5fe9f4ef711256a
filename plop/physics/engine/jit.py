"""Compile the engine's kernels with numba."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba import njit

from plop.compute.kernel_cache import watch_sources
from plop.compute.plain import plain

if not plain():  # chosen, not probed: open3d brings an older TBB, and numba warns when it finds that one
    numba.config.THREADING_LAYER = "omp"

_ENGINE = Path(__file__).parent


def kernel(*, parallel: bool = False) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Compile a function and keep the machine code between runs, for as long as no file of the engine changes.

    Args:
        parallel: Whether `prange` loops may run in threads.
    """

    def compile_function(function: Callable[..., Any]) -> Callable[..., Any]:
        return watch_sources(njit(parallel=parallel, fastmath=True, cache=not plain())(function), _ENGINE)

    return compile_function
