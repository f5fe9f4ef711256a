"""A full disk ends in one clear message and leaves nothing, and the process lives on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from plop.artifacts.atomic_hdf5 import AtomicHdf5
from plop.errors import PlopError

LIMITED = """
import resource, signal, sys
import numpy as np
import torch
from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import TrajectoryWriter
from plop.recordings.recording import Mesh
from plop.recordings.writer import RecordingWriter
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
random, poses = np.random.default_rng(0), np.tile(np.eye(4), (40, 1, 1))
try:
    {work}
except PlopError as error:
    sys.exit(error.problem)
"""
RECORDING = """
    with RecordingWriter(sys.argv[1], name="a", source="test", environment="box", table_z_m=0.0,
                         time_s=np.arange(40.0), tool_mesh=Mesh(np.eye(3), np.array([[0, 1, 2]])),
                         world_from_tool=poses) as writer:
        writer.add_camera("c", np.eye(3), poses, 64, 64)
        for frame in range(40):
            writer.write_frame("c", frame, random.integers(0, 255, (64, 64, 3), dtype=np.uint8),
                               random.random((64, 64), np.float32), np.zeros((64, 64), np.uint8))
"""
TRAJECTORY = """
    with TrajectoryWriter(sys.argv[1]) as writer:
        for frame in range(40):
            numbers = [torch.rand(500, *shape) for shape in ((3,), (4,), (3,), (), (1, 3))]
            writer.append("states", frame, Gaussians(*numbers, torch.arange(500)))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="limits the file size as only POSIX can")
@pytest.mark.parametrize("work", [RECORDING, TRAJECTORY], ids=["recording", "trajectory"])
def test_a_full_disk_is_one_clear_error_and_leaves_nothing(tmp_path: Path, work: str) -> None:
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    script = LIMITED.replace("{work}", work.strip())
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "a.h5")], env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1 and done.stderr.strip() == "The file cannot be written."
    assert list(tmp_path.iterdir()) == []


def test_committed_is_readable_and_discarded_is_gone(tmp_path: Path) -> None:
    for name, keep in (("kept.h5", True), ("dropped.h5", False)):
        output = AtomicHdf5(tmp_path / name)
        output.file["numbers"] = np.arange(1000)
        assert not (tmp_path / name).exists()
        output.commit() if keep else output.discard()
        output.discard()
    assert [path.name for path in tmp_path.iterdir()] == ["kept.h5"]
    with h5py.File(tmp_path / "kept.h5") as file:
        np.testing.assert_array_equal(file["numbers"][:], np.arange(1000))


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PlopError, match="cannot be written"):
        AtomicHdf5(tmp_path / "file" / "a.h5")
