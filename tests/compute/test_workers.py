"""All parallel work uses the same worker processes."""

from __future__ import annotations

import os

from joblib import Parallel, delayed

from plop.compute.workers import workers
from plop.diagnosis.responses.runs import Runs
from plop.pipeline.mapping import in_processes


def _number(name: str = "") -> int:
    return os.getpid()


def test_pieces_of_stages_and_other_calls_share_their_processes():
    with workers():
        first = {*Parallel(n_jobs=2)(delayed(_number)() for _ in range(4))}
    pieces = {*in_processes(_number, ["a", "b"], 2)}
    with Runs(jobs=2)._backend():
        runs = {*Parallel(n_jobs=2)(delayed(_number)() for _ in range(4))}
    assert os.getpid() not in first and len(first | pieces | runs) <= 2
