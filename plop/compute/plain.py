"""One switch, PLOP_PLAIN_THREADS=1, for everything that plop does to threads, to memory and to compiled code.

With it OpenMP threads wait as their library has them wait, freed memory goes back as the C library has it, kernels run
on the calling thread and are compiled anew in every process, and numba chooses how its own threads are started. The
numbers are the same. What decides numbers or places is no part of it: `plop.compute.determinism`, `plop.compute.device`
and the number of threads of an engine run.
"""

from __future__ import annotations

import os

PLAIN = "PLOP_PLAIN_THREADS"
"""Environment variable; processes started for a run inherit it."""


def plain() -> bool:
    """Tell whether plop leaves threads, memory and compiled code alone."""
    return os.environ.get(PLAIN) == "1"
