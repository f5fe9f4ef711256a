"""Turn one mesh sequence into one recording."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from plop.errors import PlopError
from plop.geometry.cameras import Camera
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.recordings.recording import MaskLabel, Mesh
from plop.recordings.writer import RecordingWriter
from plop.render.mesh_raycast import MeshView

Render = Callable[[int, Camera], MeshView]
"""`(frame, camera) -> what the camera records`."""


def write_episode(path: Path, sequence: MeshSequence, cameras: Sequence[Camera], render: Render) -> Iterator[int]:
    """Render every frame of every camera into a recording; yield the number of images written so far.

    Args:
        path: Where the recording goes.
        sequence: The episode.
        cameras: Fixed cameras.
        render: Gives one image, noise included.

    Raises:
        PlopError: A camera sees nothing of the object at the start, or the disk is full.
    """
    writer = RecordingWriter(
        path,
        name=sequence.name,
        source=sequence.source,
        environment=sequence.environment,
        table_z_m=sequence.table_z_m,
        time_s=sequence.times,
        world_from_tool=sequence.world_from_tool,
        tool_mesh=Mesh(sequence.tool_vertices, sequence.tool_faces),
    )
    with writer:
        for camera in cameras:
            poses = np.tile(camera.world_from_cam, (len(sequence), 1, 1))
            writer.add_camera(camera.name, camera.intrinsics, poses, camera.height, camera.width)
        done = 0
        for frame in range(len(sequence)):
            for camera in cameras:
                view = render(frame, camera)
                if frame == 0 and not (view.mask == MaskLabel.OBJECT).any():
                    raise PlopError(
                        "A camera sees nothing of the object.",
                        where=f"{sequence.name}, {camera.name}",
                        expected="object pixels in the first frame",
                        found="none",
                        fix="Check elevation, distance, field of view and the table.",
                    )
                writer.write_frame(camera.name, frame, view.rgb, view.depth_m, view.mask)
                done += 1
                yield done
        _write_truth(writer, sequence)


def _write_truth(writer: RecordingWriter, sequence: MeshSequence) -> None:
    for key, value in sorted(sequence.truth.items()):
        writer.add_truth(key, value)
    writer.add_truth("surface_vertices_m", sequence.vertices.astype(np.float32))
    writer.add_truth("surface_rest_vertices_m", sequence.rest.astype(np.float32))
    writer.add_truth("surface_faces", sequence.faces)
    writer.add_truth("surface_is_cut", sequence.is_cut_face)
    writer.add_truth_facts(json.dumps(sequence.facts, sort_keys=True))
