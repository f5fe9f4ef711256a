"""How numba kernels are compiled, and how they share the cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import count
from typing import Any

import numba
import numpy as np
import torch

from plop.compute.kernel_cache import watch_sources
from plop.compute.openmp import run_on_torch_threads
from plop.compute.plain import plain

FAST = {"reassoc", "contract", "nsz", "arcp", "afn"}
"""Allowed floating-point freedoms; NaN and infinity keep their meaning."""
PARTS_PER_THREAD = 4
"""Shares of work per thread: enough that a thread slowed down by other programs takes fewer of them."""

Step = tuple[Callable[..., None], tuple[Any, ...]]
"""A kernel and its arguments after (part, parts)."""
CROWDED = 1.5
"""Runnable processes per core above which a single thread is faster: further threads would wait for a core."""

_pools: dict[int, ThreadPoolExecutor] = {}
os.register_at_fork(after_in_child=_pools.clear)


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function to machine code on its first call; cached on disk, runs without the interpreter lock.

    It may use only functions and constants of its own folder: the cache checks only these.
    """
    return watch_sources(numba.njit(fastmath=FAST, error_model="numpy", cache=not plain(), nogil=True)(function))


def array_of(tensor: torch.Tensor) -> np.ndarray:
    """Return a CPU tensor as kernels need it: without gradient, contiguous."""
    return np.asarray(tensor.detach().contiguous().numpy())


def _threads() -> int:
    """Return torch's number of threads, or 1 where other programs keep the cores busy; results do not depend on it."""
    crowded = os.getloadavg()[0] > CROWDED * (os.cpu_count() or 1)
    return 1 if crowded or plain() else torch.get_num_threads()


def run_parallel(steps: Sequence[Step], *, parts: int | None = None, lent: bool = False) -> None:
    """Run kernels share by share on as many threads as torch uses, at most; returns when all is done.

    A thread takes a share, runs every step on it, and takes the next one; so step 2 must need only the same
    share of what step 1 wrote. Plain threads, not numba's `prange`: that needs a threading layer (open3d
    brings a TBB too old for it), its OpenMP layer changes torch's number of threads and forbids forks, and
    its barriers wait for threads that other programs have preempted.

    Args:
        steps: Kernels f(part, parts, *args) that release the interpreter lock.
        parts: Number of shares; PARTS_PER_THREAD for each thread when absent.
        lent: Use torch's own threads where possible: for kernels of a millisecond between torch's operations,
            after which these threads spin on the cores that plain ones would need.
    """
    threads = _threads()
    parts = parts or (PARTS_PER_THREAD * threads if threads > 1 else 1)
    shares = count()

    def work() -> None:
        while (part := next(shares)) < parts:
            for function, arguments in steps:
                function(part, parts, *arguments)

    helpers = min(threads, parts) - 1
    if helpers < 1:
        return work()
    if lent and run_on_torch_threads(work, helpers + 1):
        return None
    if helpers not in _pools:
        _pools[helpers] = ThreadPoolExecutor(helpers, thread_name_prefix="kernels")
    pool = _pools[helpers]
    started = [pool.submit(work) for _ in range(helpers)]
    work()
    started = [future for future in started if not future.cancel()]
    wait(started)
    for future in started:
        future.result()
