"""`torchrun -m plop_cli train`: two processes make one artifact, the one that a single process makes."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from plop.artifacts.store import Artifact, Store
from tests.pipeline.small_set import arguments

REPOSITORY = Path(__file__).resolve().parents[2]


def free_port() -> int:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        return int(server.getsockname()[1])


def losses(artifact: Artifact) -> list[float]:
    lines = (artifact.path / "log.jsonl").read_text().splitlines()
    return [json.loads(line)["loss"] for line in lines]


def test_two_processes_make_one_artifact(finished: Path, tmp_path: Path):
    alone = Store(finished).find("train@latest")
    folder = tmp_path / "workspace"
    shutil.copytree(finished, folder)
    shutil.rmtree(folder / "artifacts" / "train")
    launch = [
        sys.executable,
        "-m",
        "torch.distributed.run",
        "--master-addr",
        "127.0.0.1",
        "--master-port",
        str(free_port()),
        "--nproc-per-node",
        "2",
        "-m",
        "plop_cli",
    ]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*launch, *arguments("train", folder)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("done in") == 1
    together = Store(folder).find("train@latest")
    assert together.key == alone.key
    tracks = {name: digest for name, digest in alone.manifest.files.items() if name.startswith("tracks/")}
    assert tracks.items() <= together.manifest.files.items()
    one, two = losses(alone), losses(together)
    assert two[0] == pytest.approx(one[0], rel=1e-4)
    assert two == pytest.approx(one, rel=1e-2)  # Adam makes rounding errors of small gradients larger
