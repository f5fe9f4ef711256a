"""A step of the model beside a program that keeps a core busy: `python -m benchmarks.speed waiting`."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from statistics import median

from benchmarks.speed.dynamics import i2n_step
from benchmarks.speed.measure import median_ms

BLOCKS = 7
"""Blocks of steps with the busy program, each between two without it."""


def cases() -> dict[str, Callable[[], float]]:
    """Return each figure's name and the function that measures it."""
    return {"i2n_step_3000_beside_a_busy_core_over_quiet": beside_over_quiet}


def beside_over_quiet() -> float:
    """Time steps with and without a busy program in turn, and return the ratio of the medians."""
    step = i2n_step(3000)
    alone, beside = [median_ms(step, repeats=9, warm_up=5)], []
    for _ in range(BLOCKS):
        with busy_core():
            beside.append(median_ms(step, repeats=9, warm_up=2))
        alone.append(median_ms(step, repeats=9, warm_up=2))
    return median(beside) / median(alone)


@contextmanager
def busy_core() -> Iterator[None]:
    """Keep one core busy, as another program would."""
    other = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    time.sleep(0.3)  # until it runs
    try:
        yield
    finally:
        other.kill()
        other.wait()
