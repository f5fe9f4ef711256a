"""Numba's loops take as many threads as asked for, and torch's number stays."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
CODE = """
import torch, numba, numpy as np
import plop.physics.engine.jit
from plop.compute.numba_threads import numba_threads

@numba.njit(parallel=True)
def fill(x):
    for i in numba.prange(len(x)):
        x[i] = numba.get_num_threads()

x = np.zeros(1000)
with numba_threads({most}):
    fill(x)
print(int(x.max()), numba.get_num_threads(), torch.get_num_threads())
"""


def seen(most: int) -> list[int]:
    """Return the threads that numba used and has afterwards, and torch's afterwards, in a process that asked for 1."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "2"}
    command = [sys.executable, "-c", CODE.format(most=most)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=REPOSITORY, env=environment, check=True)
    return [int(number) for number in done.stdout.split()]


def test_torch_keeps_its_threads_where_numba_starts_its_own() -> None:
    assert seen(8) == [2, 2, 1]
    assert seen(1) == [1, 2, 1]
