"""Reuse of freed memory by the C library.

The arrays of a step of the learned dynamics at 10,000 particles are 1 to 2 MB each. glibc gives them back to the system
at the step's end and requests them again in the next one, and the system zeroes every page again: a sixth to a
quarter of the step's time.
"""

from __future__ import annotations

import ctypes
import os

from plop.compute.plain import plain

_KEPT_BYTES = 256 << 20
"""Freed memory at the heap's end that a process keeps."""
_MAPPED_BYTES = 32 << 20
"""Larger arrays are still returned immediately; glibc accepts no higher value."""
_OPTIONS = {"MALLOC_TRIM_THRESHOLD_": (-1, _KEPT_BYTES), "MALLOC_MMAP_THRESHOLD_": (-3, _MAPPED_BYTES)}
"""Name in the environment, which processes started later read; number in glibc's malloc.h; value."""


def keep_freed_memory() -> None:
    """Keep freed memory for the next step, in this process and its children; values set by the user are kept.

    Does nothing where the C library is not glibc.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if os.name == "posix" else None
    if mallopt is None or plain():
        return
    for name, (number, value) in _OPTIONS.items():
        if name not in os.environ:
            os.environ[name] = str(value)
            mallopt(number, value)
