"""One lock a fingerprint: the second run waits, and a dead run holds nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from plop.artifacts.lock import locked, note_of

HOLD = """
import sys, time
from pathlib import Path
from plop.artifacts.lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""
COUNT = """
import sys
from pathlib import Path
from plop.artifacts import lock
lock.POLL_S = 0.01
path = Path(sys.argv[2])
for _ in range(10):
    with lock.locked(Path(sys.argv[1])):
        path.write_text(str(int(path.read_text()) + 1))
"""


def test_second_waits_for_the_first(tmp_path: Path):
    path, order, waited = tmp_path / "lock", [], []

    def second() -> None:
        with locked(path, on_wait=waited.append):
            order.append("second")

    with locked(path):
        thread = threading.Thread(target=second)
        thread.start()
        thread.join(timeout=0.5)
        assert thread.is_alive()
        order.append("first")
    thread.join(timeout=5)
    assert order == ["first", "second"]
    assert waited == [str(os.getpid())]
    assert not path.exists()


def test_lock_of_a_killed_process_is_free(tmp_path: Path):
    path = tmp_path / "lock"
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert note_of(path) is None, "what it wrote is not that of a holder"
    with locked(path, on_wait=lambda pid: (_ for _ in ()).throw(AssertionError("it waited"))):
        pass


def test_a_note_is_read_while_the_lock_is_held(tmp_path: Path):
    path = tmp_path / "folder" / "lock"
    assert note_of(path) is None
    with locked(path, note=["fuse@1", "train@2"]):
        assert note_of(path) == ["fuse@1", "train@2"]
    assert note_of(path) is None and not list(path.parent.iterdir())


def test_a_lock_is_dropped_when_the_block_fails(tmp_path: Path):
    with pytest.raises(ValueError):
        with locked(tmp_path / "lock"):
            raise ValueError("broken")
    with locked(tmp_path / "lock", on_wait=lambda pid: pytest.fail("it waited")):
        pass


def test_many_processes_hold_it_one_at_a_time(tmp_path: Path):
    """Each adds one to a number in a file, which goes wrong where two read the same number."""
    (tmp_path / "count").write_text("0")
    processes = [
        subprocess.Popen([sys.executable, "-c", COUNT, str(tmp_path / "lock"), str(tmp_path / "count")])
        for _ in range(4)
    ]
    assert [process.wait(timeout=120) for process in processes] == [0] * 4
    assert (tmp_path / "count").read_text() == "40" and not (tmp_path / "lock").exists()
