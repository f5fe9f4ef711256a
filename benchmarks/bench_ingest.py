"""Speed of rendering simulated episodes and of reading recordings back."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.measure import median_ms
from plop.recordings.mesh_sequence import MeshSequence

FRAMES, CAMERAS = 10, 6


def cases() -> dict[str, Callable[[], float]]:
    """Give each figure's name and the function that measures it."""
    return {
        "ingest_128_images_per_s": ingest_rate,
        "recording_read_one_frame_ms": read_one_frame_ms,
    }


def ingest_rate() -> float:
    """Images of 128 x 128 px, 3 x 3 rays a pixel, rendered and written a second, by the whole stage."""
    from stages.contract import Input, Output
    from stages.ingest.settings import MeshConfig
    from stages.ingest.stage import INGEST_MESH

    with _raw() as raw:

        def work() -> None:
            with tempfile.TemporaryDirectory() as out:
                INGEST_MESH.run({"raw": Input(raw)}, MeshConfig(cameras=CAMERAS), Output(Path(out)))

        return FRAMES * CAMERAS / (median_ms(work, repeats=3, warm_up=1) / 1000)


def read_one_frame_ms() -> float:
    """Colour, depth, mask and calibration of one frame of one camera, a different frame each time."""
    from plop.recordings.recording import Recording
    from stages.contract import Input, Output
    from stages.ingest.settings import MeshConfig
    from stages.ingest.stage import INGEST_MESH

    with _raw() as raw, tempfile.TemporaryDirectory() as out:
        INGEST_MESH.run({"raw": Input(raw)}, MeshConfig(cameras=CAMERAS), Output(Path(out)))
        with Recording(Path(out) / "episodes" / "block.h5") as recording:
            views = [(name, frame) for frame in range(FRAMES) for name in recording.camera_names]
            return median_ms(lambda: [recording.view(*view) for view in views], warm_up=1) / len(views)


@contextmanager
def _raw() -> Iterator[Path]:
    from plop.recordings.mesh_sequence import write_mesh_sequence

    with tempfile.TemporaryDirectory() as raw:
        write_mesh_sequence(raw, _block())
        yield Path(raw)


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
        name="block", environment="block", times=np.arange(FRAMES) / 20, vertices=vertices,
        faces=np.asarray(block.faces, np.int64), tool_vertices=np.asarray(blade.vertices),
        tool_faces=np.asarray(blade.faces, np.int64), world_from_tool=poses,
    )  # fmt: skip
