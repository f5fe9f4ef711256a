"""A block of Gaussians whose halves move apart, recorded by rendering it: predictions can be exactly right."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch

from plop.dynamics.interface import ParticleState, ToolStep
from plop.gaussians.splat_ply import read_splat, write_splat
from plop.gaussians.state import Gaussians
from plop.geometry.cameras import look_at
from plop.pipeline.stage import Input
from plop.recordings.recording import Camera, Mesh
from plop.recordings.set import RecordingSet
from plop.recordings.writer import RecordingWriter
from plop.render.rasterizer.sh import C0
from plop.render.rigid_motion import moved_rigidly
from plop.render.scene import render_scene
from tests.support.box import BOX_FACES

STEP_M = 0.004
"""Each half moves this far a frame."""
SIZE_PX = 48


def grid_gaussians(extent_m: tuple[float, float, float], spacing_m: float, colour_seed: int | None) -> Gaussians:
    axes = [np.arange(-extent / 2, extent / 2 + 1e-9, spacing_m) for extent in extent_m]
    means = torch.from_numpy(np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)).float()
    count = len(means)
    colours = torch.full((count, 3), 0.5)
    if colour_seed is not None:
        colours = torch.rand(count, 3, generator=torch.Generator().manual_seed(colour_seed)) * 0.8 + 0.1
    quats = torch.zeros(count, 4)
    quats[:, 0] = 1
    scales = torch.full((count, 3), 0.6 * spacing_m)
    return Gaussians(
        means, quats, scales, torch.full((count,), 0.95), ((colours - 0.5) / C0)[:, None], torch.arange(count)
    )


def parted(block: Gaussians, frame: int) -> Gaussians:
    """Move both halves outwards along x."""
    side = torch.where(block.means[:, :1] > 0, 1.0, -1.0)
    return block.with_(means=block.means + side * torch.tensor([STEP_M * frame, 0.0, 0.0]))


@dataclass
class Parting:
    """A model that predicts the recording exactly."""

    spoil_at: int | None = None
    calls: int = 0
    seen: list[ToolStep] = field(default_factory=list)

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        self.calls += 1
        self.seen.append(action)
        side = torch.where(state.gaussians.means[:, :1] > 0, 1.0, -1.0)
        means = state.gaussians.means + side * torch.tensor([STEP_M, 0.0, 0.0])
        if self.calls == self.spoil_at:
            means[3] = float("nan")
        return replace(state, gaussians=state.gaussians.with_(means=means), has_history=True)


def cameras() -> list[Camera]:
    intrinsics = np.array([[60.0, 0, SIZE_PX / 2], [0, 60.0, SIZE_PX / 2], [0, 0, 1]])
    eyes = {"front": [0.02, -0.16, 0.12], "side": [0.15, 0.05, 0.13]}
    return [
        Camera(name, SIZE_PX, SIZE_PX, intrinsics, look_at(np.array(eye), np.zeros(3), np.array([0.0, 0, 1])))
        for name, eye in eyes.items()
    ]


def tool_poses(frames: int) -> np.ndarray:
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 2, 3] = np.linspace(0.05, 0.045, frames)
    return poses


def make_inputs(folder: Path, *, names: tuple[str, ...] = ("a",), frames: int = 4) -> dict[str, Input]:
    """Write recordings, init and an empty model folder; every episode is a test episode."""
    # 8 columns along x and none at x = 0, so that the halves are clear.
    block = grid_gaussians((0.056, 0.032, 0.024), 0.008, colour_seed=1)
    tool = grid_gaussians((0.002, 0.05, 0.016), 0.004, colour_seed=None)
    for name in names:
        (folder / "init" / name).mkdir(parents=True, exist_ok=True)
        write_splat(folder / "init" / name / "object.ply", block)
        write_splat(folder / "init" / name / "tool.ply", tool)
        stored = [read_splat(folder / "init" / name / part) for part in ("object.ply", "tool.ply")]
        write_episode(folder / "recordings" / "episodes" / f"{name}.h5", name, stored[0], stored[1], frames)
    RecordingSet(folder / "recordings", "block", [], list(names)).save()
    (folder / "model").mkdir(exist_ok=True)
    (folder / "model" / "model.json").write_text(json.dumps({"schema": 1, "training": {"environment": "block"}}))
    return {name: Input(folder / name) for name in ("recordings", "init", "model")}


def write_episode(path: Path, name: str, block: Gaussians, tool: Gaussians, frames: int) -> None:
    corners = np.array([[x, y, z] for x in (-0.001, 0.001) for y in (-0.025, 0.025) for z in (-0.008, 0.008)])
    faces = BOX_FACES
    poses = tool_poses(frames)
    with RecordingWriter(
        path,
        name=name,
        source="test",
        environment="block",
        table_z_m=None,
        time_s=0.1 * np.arange(frames),
        tool_mesh=Mesh(corners, faces),
        world_from_tool=poses,
    ) as writer:
        for camera in cameras():
            writer.add_camera(
                camera.name, camera.intrinsics, np.tile(camera.world_from_cam, (frames, 1, 1)), SIZE_PX, SIZE_PX
            )
        for frame in range(frames):
            for view in render_scene(parted(block, frame), moved_rigidly(tool, poses[frame]), cameras()):
                writer.write_frame(view.camera.name, frame, view.rgb, view.depth_m, view.mask)
        nodes = np.stack([parted(block, frame).means.numpy() for frame in range(frames)])
        writer.add_truth("nodes_m", nodes)
        writer.add_truth("node_is_real", np.ones(nodes.shape[1], bool))
        writer.add_truth("surface_vertices_m", nodes[:, :3])
        writer.add_truth("surface_faces", np.array([[0, 1, 2]]))
