"""One switch, PLOP_PLAIN_THREADS=1, that disables all tuning of threads, memory and compiled code.

With it OpenMP threads wait by their library's default, the C library frees memory by its default, kernels run
on the calling thread and are compiled again in every process, and numba chooses its own threading layer. The
results are the same. Settings that affect results or devices are not part of it: `plop.compute.determinism`,
`plop.compute.device` and the number of threads of an engine run.
"""

from __future__ import annotations

import os

PLAIN = "PLOP_PLAIN_THREADS"
"""Environment variable; processes started for a run inherit it."""


def plain() -> bool:
    """Return whether the tuning of threads, memory and compiled code is disabled."""
    return os.environ.get(PLAIN) == "1"
