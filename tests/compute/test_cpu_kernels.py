"""Kernels on several threads: torch's own, or others where those cannot be had."""

from __future__ import annotations

import os
import threading
import time
from itertools import count

import numpy as np
import pytest
import torch

from plop.compute import cpu_kernels as compiled
from plop.compute import openmp
from plop.compute.cpu_kernels import kernel, run_parallel
from plop.compute.openmp import run_on_torch_threads


@pytest.fixture
def two_threads(monkeypatch):
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    monkeypatch.setattr(compiled, "_threads", lambda: 2)
    yield
    torch.set_num_threads(before)


@kernel
def _mark(part: int, parts: int, out: np.ndarray) -> None:
    for k in range(part * len(out) // parts, (part + 1) * len(out) // parts):
        out[k] += k


@pytest.mark.parametrize("lent", [True, False])
def test_every_share_is_worked_on_once(two_threads, monkeypatch, lent):
    if not lent:
        monkeypatch.setattr(openmp, "_gnu_parallel", lambda: None)
    out = np.zeros(1001)
    for _ in range(50):
        run_parallel([(_mark, (out,)), (_mark, (out,))], lent=True)
    assert np.array_equal(out, 100 * np.arange(1001))


@pytest.mark.parametrize("lent", [True, False])
def test_an_error_in_a_share_is_raised_and_the_threads_go_on(two_threads, monkeypatch, lent):
    if not lent:
        monkeypatch.setattr(openmp, "_gnu_parallel", lambda: None)

    def fails(part: int, parts: int) -> None:
        if part == 3:
            raise ZeroDivisionError(f"share {part} of {parts}")

    with pytest.raises(ZeroDivisionError, match="share 3 of 8"):
        run_parallel([(fails, ())], lent=True)
    out = np.zeros(10)
    run_parallel([(_mark, (out,))], lent=True)
    assert np.array_equal(out, np.arange(10))


def test_torch_lends_its_own_threads(two_threads):
    if openmp._gnu_parallel() is None:
        pytest.skip("torch's OpenMP is not GNU's here")
    met, calls = set(), count()
    deadline = time.monotonic() + 20

    def work() -> None:
        next(calls)
        met.add(threading.get_native_id())
        while len(met) < 2 and time.monotonic() < deadline:  # both must be there at once
            time.sleep(0.001)

    before = len(os.listdir("/proc/self/task"))
    torch.ones(512, 512) @ torch.ones(512, 512)  # torch's threads are started
    started = len(os.listdir("/proc/self/task"))
    assert run_on_torch_threads(work, 2)
    assert len(met) == 2 and next(calls) == 2
    assert threading.get_native_id() in met
    assert len(os.listdir("/proc/self/task")) <= max(before + 1, started)


@pytest.mark.parametrize("lent", [True, False])
def test_a_forked_process_does_not_wait_for_threads_that_it_has_not(two_threads, monkeypatch, lent):
    if not lent:
        monkeypatch.setattr(openmp, "_gnu_parallel", lambda: None)
    run_parallel([(_mark, (np.zeros(10),))], lent=True)
    child = os.fork()
    if child == 0:
        out = np.zeros(100)
        run_parallel([(_mark, (out,))], lent=True)
        os._exit(0 if np.array_equal(out, np.arange(100)) else 1)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            assert os.waitstatus_to_exitcode(status) == 0
            return
        time.sleep(0.01)
    os.kill(child, 9)
    os.waitpid(child, 0)
    pytest.fail("the forked process hangs")
