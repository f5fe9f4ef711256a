"""docs/how-to/cluster.md: its programs start workers that have plop, with a queue and pods of this machine's own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
PAGE = (REPOSITORY / "docs" / "how-to" / "cluster.md").read_text()
SLURM, KUBERNETES = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
SBATCH = '#!/bin/sh\ncp "$1" "$0.script"\nsetsid sh "$0.script" > "$0.log" 2>&1 &\necho "Submitted batch job $!"\n'
SCANCEL = '#!/bin/sh\nfor job in "$@"; do kill -TERM -- "-$job"; done\n'


@pytest.fixture
def queue(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Slurm's two commands, for a queue in which every job starts at once."""
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(REPOSITORY))
    return tmp_path


def plop_on(address: str) -> str:
    """Ask a worker where its plop is."""
    from distributed import Client

    with Client(address) as client:
        return str(client.submit(lambda: __import__("plop").__file__).result(timeout=120))


def test_slurm(queue: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("dask_jobqueue", reason="needs dask-jobqueue: pip install dask-jobqueue")
    found: list[str] = []
    page: dict[str, Any] = {}
    monkeypatch.setattr("builtins.input", lambda _: found.append(plop_on(page["cluster"].scheduler_address)))
    try:
        exec(SLURM, page)
    finally:
        page["cluster"].close()
    assert found == [str(REPOSITORY / "plop" / "__init__.py")]
    assert capsys.readouterr().out.startswith("tcp://"), "the address for --scheduler"
    script = (queue / "sbatch.script").read_text()
    assert "--nthreads 1" in script and "#SBATCH --mem=8G" in script


@pytest.fixture
def processes() -> Iterator[list[subprocess.Popen[bytes]]]:
    started: list[subprocess.Popen[bytes]] = []
    yield started
    for process in started:
        process.terminate()
        process.wait(timeout=30)


def test_kubernetes(tmp_path: Path, processes: list[subprocess.Popen[bytes]]) -> None:
    """Its pods are started as processes, since there is no cluster: their commands must exist."""
    pytest.importorskip("dask_kubernetes", reason="needs dask-kubernetes: pip install dask-kubernetes")
    page: dict[str, Any] = {}
    exec(KUBERNETES.partition("cluster = ")[0], page)
    spec = page["spec"]["spec"]
    for kind in ("scheduler", "worker"):
        pod = spec[kind]["spec"]
        [mount] = pod["containers"][0]["volumeMounts"]
        assert mount["name"] == pod["volumes"][0]["name"]
    address = tmp_path / "scheduler.json"
    here = ["--scheduler-file", str(address), "--no-dashboard"]
    _start(processes, [*spec["scheduler"]["spec"]["containers"][0]["args"], "--port", "0", *here])
    while not address.is_file():
        assert processes[0].poll() is None
        time.sleep(0.1)
    words = spec["worker"]["spec"]["containers"][0]["args"]
    _start(processes, [*words[: words.index("--dashboard")], *here])
    from distributed import Client

    with Client(scheduler_file=str(address)) as client:
        assert client.submit(lambda: 1 + 1).result(timeout=120) == 2


def _start(processes: list[subprocess.Popen[bytes]], words: list[str]) -> None:
    program = Path(sys.executable).with_name(words[0])
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    processes.append(subprocess.Popen([str(program), *words[1:]], env=environment))
