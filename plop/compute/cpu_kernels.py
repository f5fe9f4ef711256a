"""How numba kernels are compiled, and how they share the cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from itertools import count
from queue import SimpleQueue
from threading import Lock, Thread
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

_helpers: list[Thread] = []
_offers: SimpleQueue[Callable[[], None]] = SimpleQueue()


def _after_fork() -> None:
    global _offers  # where a thread waited that does not exist any more
    _offers = SimpleQueue()
    _helpers.clear()


os.register_at_fork(after_in_child=_after_fork)


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function to machine code on its first call; cached on disk, runs without the interpreter lock.

    It may use only functions and constants of its own folder and of this one: the cache checks only these.
    """
    options = {"fastmath": FAST, "error_model": "numpy", "cache": not plain(), "nogil": True, "forceinline": True}
    return watch_sources(numba.njit(**options)(function))


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
    shares, ended, over = count(), count(1), Lock()
    raised: list[BaseException] = []
    over.acquire()

    def work() -> None:
        while (part := next(shares)) < parts:
            try:
                for function, arguments in steps:
                    function(part, parts, *arguments)
            except BaseException as error:
                raised.append(error)
            if next(ended) == parts:
                over.release()

    helpers = min(threads, parts) - 1
    if helpers < 1 or not (lent and run_on_torch_threads(work, helpers + 1)):
        for _ in range(len(_helpers), helpers):
            _helpers.append(Thread(target=_help, name=f"kernels-{len(_helpers)}", daemon=True))
            _helpers[-1].start()
        for _ in range(helpers):
            _offers.put(work)
        work()
        over.acquire()
    if raised:
        raise raised[0]


def _help() -> None:
    """Take part in each piece of work that is offered; one that has ended since has no shares left."""
    while True:
        _offers.get()()
