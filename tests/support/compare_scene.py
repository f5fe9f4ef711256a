"""A box that is cut and pushed apart, recorded, with Gaussians on its surface and exact tracks of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import trimesh

from plop.dynamics.i2n.model_io import MODEL_SCHEMA
from plop.dynamics.interface import at_rest
from plop.gaussians.splat_ply import read_splat, write_splat
from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import TrajectoryWriter
from plop.pipeline.stage import Input
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.recordings.set import RecordingSet
from plop.render.virtual_cameras.recorder import record
from plop.render.virtual_cameras.settings import CameraSettings
from tests.support.box_sequence import BLADE, BLADE_FACES, box_sequence

FRAMES = 9
PUSH_M = 0.004
"""Motion of the right half in frames 5 and 6 [m]."""
# Height of the blade's edge and place along x: down from above, a rest, aside, a rest, up.
_EDGE_Z = np.array([0.045, 0.034, 0.015, 0.002, 0.002, 0.002, 0.002, 0.002, 0.03])
_BLADE_X = np.array([0, 0, 0, 0, 0, 1, 2, 2, 2]) * PUSH_M
PHASE_NAMES = ["approach", "approach", "cut", "cut", "hold", "contact", "contact", "hold", "retract"]


def cut_and_push(name: str) -> MeshSequence:
    """Give the episode: 60 x 60 x 30 mm, cut at x = 0, the right half pushed along x."""
    still = box_sequence(name, frames=FRAMES, gap_m=0.0)
    vertices = still.vertices.copy()
    vertices[:, 8:, 0] += _BLADE_X[:, None]
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 0, 3], poses[:, 2, 3] = _BLADE_X, _EDGE_Z + 0.03
    return replace(still, vertices=vertices, world_from_tool=poses, tool_faces=BLADE_FACES.copy())


def splats(points: np.ndarray, scale_m: float, seed: int) -> Gaussians:
    """Put small opaque Gaussians at points."""
    count = len(points)
    colours = torch.rand(count, 1, 3, generator=torch.Generator().manual_seed(seed)) - 0.5
    quats = torch.tensor([1.0, 0, 0, 0]).expand(count, 4).clone()
    return Gaussians(
        torch.from_numpy(points).float(),
        quats,
        torch.full((count, 3), scale_m),
        torch.full((count,), 0.9),
        colours,
        torch.arange(count),
    )


def surface_points(count: int) -> np.ndarray:
    """Spread points over the whole box but its underside, [about count, 3] [m]."""
    box = trimesh.creation.box((0.06, 0.06, 0.03), trimesh.transformations.translation_matrix([0, 0, 0.015]))
    points = np.asarray(trimesh.sample.sample_surface_even(box, 2 * count, seed=0)[0], float)
    return points[points[:, 2] > 1e-4][:count]


def make_inputs(folder: Path, names: tuple[str, ...] = ("box_000", "box_001")) -> dict[str, Input]:
    """Write recordings, init, tracks and a model that is never run; the last episode is held out."""
    points = surface_points(700)
    parts = {part: folder / part for part in ("recordings", "init", "tracks", "model")}
    for path in (*parts.values(), parts["recordings"] / "episodes"):
        path.mkdir(parents=True, exist_ok=True)
    for name in names:
        sequence = cut_and_push(name)
        settings = CameraSettings(size=48, count=4, supersample=1)
        list(record(parts["recordings"] / "episodes" / f"{name}.h5", sequence, settings))
        (parts["init"] / name).mkdir(exist_ok=True)
        write_splat(parts["init"] / name / "object.ply", splats(points, 0.0015, 0))
        blade = trimesh.Trimesh(BLADE, BLADE_FACES).sample(300, seed=0)
        write_splat(parts["init"] / name / "tool.ply", splats(np.asarray(blade), 0.002, 1))
        write_track(parts["tracks"] / f"{name}.h5", read_splat(parts["init"] / name / "object.ply"))
    RecordingSet(parts["recordings"], "box", list(names[:-1]), list(names[-1:])).save()
    facts = {"schema": MODEL_SCHEMA, "kind": "plop", "training": {"environment": "box"}}
    (parts["model"] / "model.json").write_text(json.dumps(facts))
    return {name: Input(path) for name, path in parts.items()}


def moved(points: np.ndarray, frame: int) -> np.ndarray:
    """True places of material points, [N, 3] [m]."""
    return points + np.array([1.0, 0, 0]) * np.where(points[:, :1] > 0, _BLADE_X[frame], 0.0)


def write_track(path: Path, first: Gaussians) -> None:
    """Write what a filter would that follows exactly."""
    start = first.means.double().numpy()
    state = at_rest(first)
    with TrajectoryWriter(path) as track:
        for frame in range(1, FRAMES):
            means = torch.from_numpy(moved(start, frame)).float()
            side = torch.from_numpy(np.sign(start[:, 0])).float()
            track.append("updated", frame, state.gaussians.with_(means=means), side=side)
