"""The small recording that the benchmarks of the pipeline share."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from plop.recordings.readers.mesh.sequence import MeshSequence, write_mesh_sequence

FRAMES, CAMERAS = 10, 6


@contextmanager
def raw_block() -> Iterator[Path]:
    """Yield a folder with the block as a raw mesh sequence."""
    with tempfile.TemporaryDirectory() as raw:
        write_mesh_sequence(raw, _block())
        yield Path(raw)


@contextmanager
def recorded_block() -> Iterator[Path]:
    """Yield the block's recording: 10 frames of 6 cameras, 128 x 128 px, in a folder that may be written to."""
    with raw_block() as raw, tempfile.TemporaryDirectory() as out:
        yield record(raw, Path(out))


def record(raw: Path, out: Path) -> Path:
    """Ingest the raw block into a folder; give the recording's path."""
    from plop.pipeline.stage import Input, Output
    from plop.render.virtual_cameras.settings import CameraSettings
    from stages.ingest.settings import MeshConfig
    from stages.ingest.stage import INGEST_MESH

    INGEST_MESH.run({"raw": Input(raw)}, MeshConfig(cameras=CameraSettings(count=CAMERAS)), Output(out))
    return out / "episodes" / "block.h5"


def _block() -> MeshSequence:
    """A 100 x 100 x 50 mm block of 3,072 triangles that shears a little, under a blade that comes down."""
    import trimesh

    block = trimesh.creation.box(extents=(0.1, 0.1, 0.05))
    for _ in range(4):
        block = block.subdivide()
    rest = np.asarray(block.vertices) + [0, 0, 0.025]
    blade = trimesh.creation.box(extents=(0.002, 0.15, 0.04))
    shear = np.linspace(0, 0.1, FRAMES)[:, None] * rest[:, 2]
    vertices = np.tile(rest, (FRAMES, 1, 1))
    vertices[..., 0] += shear
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 2, 3] = np.linspace(0.09, 0.06, FRAMES)
    return MeshSequence(
        name="block",
        environment="block",
        times=np.arange(FRAMES) / 20,
        vertices=vertices,
        faces=np.asarray(block.faces, np.int64),
        tool_vertices=np.asarray(blade.vertices),
        tool_faces=np.asarray(blade.faces, np.int64),
        world_from_tool=poses,
    )
