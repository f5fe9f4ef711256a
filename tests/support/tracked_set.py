"""A small set of simulated recordings with Gaussians, exact tracks and an engine: what diagnosis reads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import torch
import trimesh

from plop.dynamics.i2n.model_io import MODEL_SCHEMA
from plop.gaussians.splat_ply import read_splat, write_splat
from plop.gaussians.trajectory import TrajectoryWriter
from plop.physics.adapters.base_io import base_to_dict
from plop.physics.effects.effect import Effect
from plop.physics.scenes.scene import simulate_episode
from plop.physics.scenes.sealed import seal_answer
from plop.pipeline.stage import Input
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet
from plop.render.virtual_cameras.recorder import record
from plop.render.virtual_cameras.settings import CameraSettings
from tests.support.coarse_episodes import BASE, SCENE, gaussians

POINTS = 500


def surface_paths(sequence: MeshSequence) -> np.ndarray:
    """Follow points spread over the outer surface but its underside, [T, N, 3] [m]."""
    outer = sequence.faces[~sequence.is_cut_face]
    mesh = trimesh.Trimesh(sequence.vertices[0], outer, process=False)
    places, face = trimesh.sample.sample_surface(mesh, 2 * POINTS, seed=0)
    keep = np.flatnonzero(places[:, 2] > 2e-3)[:POINTS]
    corners = outer[face[keep]]
    weights = trimesh.triangles.points_to_barycentric(mesh.vertices[corners], places[keep])
    return np.einsum("tncd,nc->tnd", sequence.vertices[:, corners].astype(float), weights)


def write_track(path: Path, splat: Path, paths: np.ndarray) -> None:
    """Write what a filter would that follows exactly."""
    first = read_splat(splat)
    with TrajectoryWriter(path) as track:
        for frame in range(1, len(paths)):
            means = torch.from_numpy(paths[frame]).float()
            track.append("updated", frame, first.with_(means=means), side=torch.zeros(len(first)))


def write_recordings(folder: Path, count: int, effects: tuple[Effect, ...] = (), name: str = "") -> dict[str, Input]:
    """Write `count` episodes; inputs are named `recordings`, `init`, `tracks`, after `name`."""
    parts = {part: folder / part for part in ("recordings", "init", "tracks")}
    for path in (*parts.values(), parts["recordings"] / "episodes"):
        path.mkdir(parents=True, exist_ok=True)
    names = []
    for k in range(count):
        sequence = simulate_episode(SCENE, k, effects)
        names.append(sequence.name)
        list(
            record(
                parts["recordings"] / "episodes" / f"{sequence.name}.h5",
                sequence,
                CameraSettings(size=80, count=4, supersample=1),
            )
        )
        paths = surface_paths(sequence)
        (parts["init"] / sequence.name).mkdir(exist_ok=True)
        splat = parts["init"] / sequence.name / "object.ply"
        write_splat(splat, gaussians(paths[0]))
        write_track(parts["tracks"] / f"{sequence.name}.h5", splat, paths)
    RecordingSet(parts["recordings"], SCENE.name, names[:-1], names[-1:]).save()
    seal_answer(parts["recordings"], {"effects": {e.name: e.values for e in effects}})
    return {f"{name}{part}": Input(path) for part, path in parts.items()}


def write_tool_splats(recordings: Path, init: Path) -> None:
    """Write Gaussians of the tool beside those of the object, for stages that render."""
    for path in sorted((recordings / "episodes").glob("*.h5")):
        with Recording(path) as recording:
            mesh = recording.tool_mesh
        write_splat(init / path.stem / "tool.ply", gaussians(mesh.vertices.astype(float)))


def write_engine(folder: Path, environment: str = SCENE.name) -> Input:
    """Write the engine as a model."""
    folder.mkdir(parents=True, exist_ok=True)
    facts = {
        "schema": MODEL_SCHEMA,
        "kind": "engine",
        "engine": base_to_dict(BASE),
        "training": {"environment": environment},
    }
    (folder / "model.json").write_text(json.dumps(facts))
    return Input(folder)
