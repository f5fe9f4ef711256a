"""The same numbers from the same seed, on any number of threads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def deterministic() -> Iterator[None]:
    """Make torch use deterministic algorithms where it has them.

    On several threads the gradient of indexing, in particular, is summed in the order in which threads finish.
    """
    before = torch.get_deterministic_debug_mode()
    # the same switch as `use_deterministic_algorithms`, which imports torch's compiler, too: seconds in every process
    torch.set_deterministic_debug_mode("warn")
    try:
        yield
    finally:
        torch.set_deterministic_debug_mode(before)
