"""Torch's own OpenMP threads, for kernels between torch's operations.

After each of its operations torch's threads wait for the next one by spinning. A second pool of threads shares the
cores with these: its kernels run hardly faster than on one thread. Where torch's OpenMP is GNU's, its threads can be
used for other work: they start immediately.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path

import torch

_BODY = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
_forked = [False]


def _after_fork() -> None:
    # The threads of GNU OpenMP do not exist in a forked process, which would wait for them forever.
    _forked[0] = True


os.register_at_fork(after_in_child=_after_fork)


def run_on_torch_threads(work: Callable[[], None], threads: int) -> bool:
    """Call a function once on each of so many threads of torch, the calling one among them; wait for all.

    Args:
        work: Must release the interpreter lock; otherwise threads bring no gain.
        threads: At most torch's number of threads, so that none is started for this.

    Returns:
        False, with nothing done, where torch's threads cannot be used: another OpenMP than GNU's, a forked process.

    Raises:
        BaseException: The first exception of a call, raised after all calls have ended.
    """
    parallel = None if _forked[0] else _gnu_parallel()
    if parallel is None:
        return False
    raised: list[BaseException] = []

    def body(_: int | None) -> None:
        try:
            work()
        except BaseException as error:
            raised.append(error)

    parallel(_BODY(body), None, threads, 0)
    if raised:
        raise raised[0]
    return True


@cache
def _gnu_parallel() -> Callable[..., None] | None:
    """GOMP_parallel(body, data, threads, flags) of the library that torch itself has loaded."""
    folder = Path(torch.__file__).parent
    for path in sorted([*folder.glob("lib/libgomp*.so*"), *folder.with_name("torch.libs").glob("libgomp*.so*")]):
        try:
            parallel = ctypes.CDLL(str(path)).GOMP_parallel
        except (OSError, AttributeError):
            continue
        parallel.argtypes = [_BODY, ctypes.c_void_p, ctypes.c_uint, ctypes.c_uint]
        parallel.restype = None
        return parallel
    return None
