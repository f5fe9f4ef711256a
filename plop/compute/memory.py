"""How much memory is still available to a process."""

from __future__ import annotations

from pathlib import Path

_MACHINE = Path("/proc/meminfo")
_GROUP = Path("/sys/fs/cgroup")
"""Control group (version 2) that a container, or a cluster's job, runs in."""


def available_bytes() -> int | None:
    """Return the memory that is free, or can be freed, within the limits of machine and container; None if unknown."""
    known = [each for each in (_of_machine(), _of_group()) if each is not None]
    return min(known, default=None)


def _of_machine() -> int | None:
    try:
        lines = _MACHINE.read_text().splitlines()
        return next(1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, ValueError, StopIteration):
        return None


def _of_group() -> int | None:
    try:
        limit, used = ((_GROUP / name).read_text() for name in ("memory.max", "memory.current"))
        stat = dict(line.split() for line in (_GROUP / "memory.stat").read_text().splitlines())
        return int(limit) - int(used) + int(stat["inactive_file"])  # the page cache is freed on demand
    except (OSError, ValueError, KeyError):
        return None  # no group, or one without a limit: "max"
