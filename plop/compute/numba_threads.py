"""The number of threads of compiled loops, without a change to torch's."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numba


@contextmanager
def numba_threads(most: int) -> Iterator[None]:
    """Run numba's parallel loops on at most so many threads.

    When numba starts its OpenMP threads, it sets the number for everything that uses this OpenMP, torch among it: a
    program that had asked for one thread would train on two after its first run of the engine, to other last digits.
    """
    torch = sys.modules.get("torch")
    torch_before = torch.get_num_threads() if torch is not None else 0
    before = numba.get_num_threads()  # starts the threads
    numba.set_num_threads(min(most, before))
    try:
        yield
    finally:
        numba.set_num_threads(before)
        if torch is not None and torch.get_num_threads() != torch_before:
            torch.set_num_threads(torch_before)
