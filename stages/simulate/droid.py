"""A simulated episode in DROID's raw layout: two exterior cameras, the tool on a robot's flange, 15 Hz."""

from __future__ import annotations

import os
import shutil
from contextlib import ExitStack
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.geometry.cameras import Camera
from plop.geometry.rigid import invert_rigid, pose_from_euler_xyz
from plop.recordings.readers.droid.writer import STEP_MS, RawCamera, write_droid_episode
from plop.recordings.readers.mesh.resample import resampled
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.render.virtual_cameras.recorder import Disturbances, as_recorded, cameras_of, disturbed_render
from plop.render.virtual_cameras.settings import CameraSettings

BASE_FROM_WORLD = pose_from_euler_xyz(np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0]))
"""The object is half a metre in front of the robot."""
FLANGE_FROM_TOOL = np.array([0.0, 0.0, 0.22, np.pi, 0.0, 0.0])
"""The flange points down, with the tool's lower end 22 cm below it: metres, Euler radians."""
_FIRST = datetime(2024, 1, 1, 12, 0, 0)
_AROUND_M = 0.06


def write_droid(
    folder: Path,
    draft: Path,
    k: int,
    sequence: MeshSequence,
    settings: CameraSettings,
    disturbances: Disturbances,
    *,
    seed: int = 0,
) -> None:
    """Write one episode atomically.

    Args:
        folder: The raw folder; the episode goes to SIM/success/<date>/<time> in it.
        draft: Scratch folder on the same disk.
        k: Number of the episode: its minute.
        sequence: The episode.
        settings: Cameras and noise, the same as of the recording.
        disturbances: Faults of cameras and tool.
        seed: Seed of texture and noise.

    Raises:
        PlopError: The rig has fewer than two cameras.
    """
    ring = cameras_of(sequence, settings)
    if len(ring) < 2:
        raise PlopError(
            "DROID episodes need two exterior cameras.",
            where="simulate.cameras.count",
            expected="2 or more",
            found=str(len(ring)),
            fix="Set simulate.cameras.count to 2 or more, or omit --droid.",
        )
    end = float(sequence.times[-1])
    slow = resampled(sequence, np.arange(0, end + STEP_MS / 2000, STEP_MS / 1000))
    chosen = [ring[0], ring[len(ring) // 2]]
    with ExitStack() as stack:
        render = disturbed_render(slow, chosen, settings, disturbances, stack, seed=seed)
        views = [[render(frame, camera) for camera in chosen] for frame in range(len(slow))]
    said = as_recorded(slow, disturbances.faults)
    cameras = [
        RawCamera(
            f"1000000{number}",
            number,
            [row[number - 1].rgb for row in views],
            _pose6(_in_base(camera)),
            intrinsics=_integer_centres(camera),
            depth_m=[row[number - 1].depth_m for row in views],
        )
        for number, camera in enumerate(chosen, 1)
    ]
    flange = BASE_FROM_WORLD @ said.world_from_tool @ invert_rigid(pose_from_euler_xyz(FLANGE_FROM_TOOL))
    shutil.rmtree(draft, ignore_errors=True)
    written = write_droid_episode(
        draft,
        cameras,
        np.stack([_pose6(pose) for pose in flange]),
        moment=_FIRST + timedelta(minutes=k),
        notes=_notes(sequence),
    )
    trimesh.Trimesh(said.tool_vertices, said.tool_faces, process=False).export(written / "tool.stl")
    target = folder / written.relative_to(draft)
    shutil.rmtree(target, ignore_errors=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    os.replace(written, target)


def _notes(sequence: MeshSequence) -> dict[str, object]:
    """Return the content of plop_episode.json: the tool, the workspace and the table, in the robot's base."""
    points = np.concatenate([sequence.rest, *sequence.vertices]) + BASE_FROM_WORLD[:3, 3]
    low, high = points.min(0) - _AROUND_M, points.max(0) + _AROUND_M
    return {
        "tool": {"mesh": "tool.stl", "flange_from_tool": FLANGE_FROM_TOOL.tolist()},
        "workspace": {"min": low.round(4).tolist(), "max": high.round(4).tolist()},
        "table_z": sequence.table_z_m,
    }


def _in_base(camera: Camera) -> np.ndarray:
    return BASE_FROM_WORLD @ camera.world_from_cam


def _pose6(pose: np.ndarray) -> np.ndarray:
    return np.concatenate([pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")])


def _integer_centres(camera: Camera) -> np.ndarray:
    """Return K in DROID's convention, pixel centres at integers."""
    matrix = camera.intrinsics.copy()
    matrix[:2, 2] -= 0.5
    return matrix
