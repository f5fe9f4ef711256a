"""Freed memory is kept for the next step."""

import os
import platform
import subprocess
import sys

import pytest

from plop.compute.malloc import keep_freed_memory

_FAULTS = """
import resource, sys
import numpy as np
from plop.compute.malloc import keep_freed_memory

if sys.argv[1] == "keep":
    keep_freed_memory()
for repeat in range(60):
    if repeat == 10:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    several = [np.ones(500_000) for _ in range(5)]
    del several
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""
glibc = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc alone has these options")


def faults(word: str, **environment: str) -> int:
    """Count the pages that the system had to supply for 50 times five arrays of 4 MB, 51,000 pages if each time."""
    path = {"PATH": "/usr/bin", "PYTHONPATH": ":".join(sys.path)}
    return int(
        subprocess.run(
            [sys.executable, "-c", _FAULTS, word], env=path | environment, text=True, check=True, capture_output=True
        ).stdout
    )


@glibc
def test_arrays_come_from_memory_that_was_freed():
    assert faults("keep") < 500 < faults("let go")


@glibc
def test_processes_started_later_keep_it_too(monkeypatch):
    for name in ("MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_"):
        monkeypatch.setenv(name, "to be undone")
        monkeypatch.delenv(name)
    keep_freed_memory()
    inherited = {name: value for name, value in os.environ.items() if name.startswith("MALLOC_")}
    assert faults("let go", **inherited) < 500


@glibc
def test_what_the_user_has_set_stays(monkeypatch):
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "4096")
    keep_freed_memory()
    assert os.environ["MALLOC_TRIM_THRESHOLD_"] == "4096"
