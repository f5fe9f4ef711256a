"""How threads wait for one another: spinning for as long as falling asleep costs, and no longer.

Between two parallel sections the threads of GNU OpenMP, which torch uses, spin for up to 15 ms before they sleep.
Where another program keeps a core busy, a spinning thread occupies the core that the thread it waits for needs, and
each of the hundreds of sections of a step costs a time slice of the scheduler. A thread that never spins pays for
sleeping and waking up in each section. Spinning for about as long as that takes costs at most twice the optimum
(Karlin et al., Empirical studies of competitive spinning, 1991). docs/results/speed.md compares the three.

The threads of OpenBLAS, which numpy uses, spin until the last of them is done, and no setting ends that: with two of
them `diagnose` takes four times as long beside a training as alone, with one a third more (docs/results/speed.md). Its
products are many and small; what runs in parallel here are episodes, runs of the engine and compiled loops. And one
thread adds up in the same order on every machine.

A library reads its environment when it is loaded, so this has to happen before torch and numpy are imported: `plop`
does it when it is imported, in every command and every worker process. A program that imports them first must set the
variables itself.
"""

from __future__ import annotations

import os

from plop.compute.plain import plain

POLICY = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME")
"""Names in the environment that say how OpenMP threads wait: the standard's, GNU's (turns of a loop), LLVM's and
Intel's [ms]."""
SPIN = {"GOMP_SPINCOUNT": "1000", "KMP_BLOCKTIME": "1"}
"""A turn is a pause of the processor, 140 cycles on recent ones of Intel: 1,000 are about 50 us, a wake-up's time."""


BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "1")
"""Set whether or not threads are tuned: products on more threads have other last digits."""


def wait_briefly() -> None:
    """Let OpenMP threads spin briefly, here and in processes started from here, and numpy's BLAS use one thread.

    Values set by the user are kept.
    """
    if not plain() and not any(name in os.environ for name in POLICY):
        os.environ.update(SPIN)
    os.environ.setdefault(*BLAS_THREADS)
