"""kill -9 in the middle of every real stage, run again: the same payload as undisturbed."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from plop.artifacts.manifest import content_files
from plop.artifacts.store import Store
from plop_cli.app import main
from tests.pipeline.small_set import COMMANDS, arguments

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("command", COMMANDS)
def test_killed_stage_goes_on_to_the_same_result(finished: Path, tmp_path: Path, command: str):
    stage = command.split()[0]
    expected = Store(finished).find(f"{stage}@latest").manifest
    folder = tmp_path / "workspace"
    shutil.copytree(finished, folder)
    shutil.rmtree(folder / "artifacts" / stage)
    # a convolution's gradient is added up in as many parts as there are threads: other threads round otherwise
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "OMP_NUM_THREADS": str(torch.get_num_threads())}
    process = subprocess.Popen(
        [sys.executable, "-m", "plop_cli", *arguments(command, folder), "-q"],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    _wait_until_it_writes(folder / "artifacts" / stage, process)
    process.send_signal(signal.SIGKILL)
    said = process.communicate()[1]
    assert process.returncode == -signal.SIGKILL, f"it ended before it was killed: {said}"
    assert not Store(folder).artifacts(stage)
    assert main([*arguments(command, folder), "-q"]) == 0
    found = Store(folder).find(f"{stage}@latest").manifest
    assert found.fingerprint == expected.fingerprint
    assert content_files(found) == content_files(expected)


def _wait_until_it_writes(folder: Path, process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + 120
    while not any(path.is_file() for path in folder.glob(".partial-*/**/*")):
        assert process.poll() is None, f"it ended before it wrote: {process.communicate()[1]}"
        assert time.monotonic() < end, "it wrote nothing"
        time.sleep(0.005)
