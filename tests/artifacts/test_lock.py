"""One lock a fingerprint: the second run waits, and a dead run holds nothing."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from pathlib import Path

from plop.artifacts.lock import locked

HOLD = """
import sys, time
from pathlib import Path
from plop.artifacts.lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
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
    assert len(waited) == 1
    assert not path.exists()


def test_lock_of_a_killed_process_is_free(tmp_path: Path):
    path = tmp_path / "lock"
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    with locked(path, on_wait=lambda pid: (_ for _ in ()).throw(AssertionError("it waited"))):
        pass
