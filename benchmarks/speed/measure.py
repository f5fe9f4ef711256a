"""Medians of repeated measurements."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable


def median_ms(work: Callable[[], object], *, repeats: int = 7, warm_up: int = 2) -> float:
    """Time a piece of work.

    Args:
        work: What to time; called `warm_up + repeats` times.
        repeats: Number of timed calls.
        warm_up: Calls before, for compilation and caches.

    Returns:
        Median wall time of one call [ms].
    """
    for _ in range(warm_up):
        work()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return 1000 * statistics.median(times)


def median_ratio(work: Callable[[], object], over: Callable[[], object], *, blocks: int = 9) -> float:
    """Time two pieces of work alternately, in blocks of calls, and return the ratio of the medians.

    Other programs slow both down. The first calls of a block are not timed: they find caches and memory
    as the other piece has left them.
    """
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(blocks):
        for piece, kept in zip((work, over), times, strict=True):
            kept.append(median_ms(piece, repeats=7, warm_up=3))
    return statistics.median(times[0]) / statistics.median(times[1])
