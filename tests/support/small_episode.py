"""A recording small enough for the tests of train and filter: a block of Gaussians, rendered by ourselves.

A blade divides the block and pushes one half along x; the truth is known without any simulator.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from plop.dynamics.cut import advance_sides
from plop.dynamics.interface import ToolStep, at_rest
from plop.gaussians.splat_ply import write_splat
from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera, look_at
from plop.recordings.recording import Mesh
from plop.recordings.set import RecordingSet
from plop.recordings.writer import RecordingWriter
from plop.render.rasterizer.rasterize import render
from tests.dynamics.conftest import blade, block_of, pose

FRAMES = 6
PUSH_M = 0.002
"""Motion of the pushed half in each of the last three steps [m]."""
SIZE = 40


def cameras() -> list[Camera]:
    """Three cameras around the block."""
    middle = np.array([0.03, 0.02, 0.015])
    eyes = [middle + 0.2 * np.array([np.cos(a), np.sin(a), 0.7]) for a in (0.3, 2.4, 4.5)]
    intrinsics = np.array([[70.0, 0, SIZE / 2], [0, 70.0, SIZE / 2], [0, 0, 1]])
    up = np.array([0.0, 0.0, 1.0])
    return [Camera(f"cam{i}", SIZE, SIZE, intrinsics, look_at(eye, middle, up)) for i, eye in enumerate(eyes)]


def poses() -> torch.Tensor:
    """The blade comes down through the middle, then moves along x."""
    down = [pose(0.03, 0.02, z) for z in (0.04, 0.015, -0.005)]
    side = [pose(0.03 + PUSH_M * k, 0.02, -0.005) for k in (1, 2, 3)]
    return torch.stack(down + side)


def coloured_block(count: int = 250) -> Gaussians:
    """A block whose colour changes with place."""
    block = block_of(count)
    colour = torch.sin(block.means[:, None, :] * torch.tensor([200.0, 300.0, 250.0]))
    scales = torch.full((count, 3), 0.0035)
    return block.with_(sh=colour, scales=scales, opacities=torch.full((count,), 0.9))


def truth(block: Gaussians) -> list[Gaussians]:
    """True states of all frames."""
    tool, moving = blade(), poses()
    state, states = at_rest(block), [block]
    side = state.side
    for frame in range(1, FRAMES):
        action = ToolStep(tool, moving[frame - 1], moving[frame], 0.04, 0.0)
        means = states[-1].means
        if frame >= 3:
            means = means + (side > 0)[:, None] * torch.tensor([PUSH_M, 0.0, 0.0])
        side = advance_sides(side, means, action)
        states.append(block.with_(means=means))
    return states


def write_episode(folder: Path, name: str) -> list[Gaussians]:
    """Write one recording; gives its true states."""
    states = truth(coloured_block())
    tool = blade()
    mesh = Mesh(tool.vertices.double().numpy(), tool.faces.numpy())
    with RecordingWriter(
        folder / f"{name}.h5",
        name=name,
        source="test",
        environment="block",
        table_z_m=0.0,
        time_s=np.arange(FRAMES) * 0.04,
        tool_mesh=mesh,
        world_from_tool=poses().double().numpy(),
    ) as writer:
        for camera in cameras():
            fixed = np.repeat(camera.world_from_cam[None], FRAMES, 0)
            writer.add_camera(camera.name, camera.intrinsics, fixed, SIZE, SIZE)
        for frame, state in enumerate(states):
            for camera in cameras():
                view = render(state, camera)
                mask = (view.alpha > 0.5).numpy()
                rgb = (view.rgb.clamp(0, 1) * 255).byte().numpy() * mask[..., None]
                writer.write_frame(camera.name, frame, rgb, view.depth_m.numpy() * mask, mask.astype(np.uint8))
    return states


def write_set(folder: Path, train: int = 2, test: int = 1) -> tuple[Path, Path]:
    """Write a recording set and fitted Gaussians; gives the folders of both."""
    recordings, init = folder / "recordings", folder / "init"
    (recordings / "episodes").mkdir(parents=True)
    names = [f"episode_{i}" for i in range(train + test)]
    for name in names:
        states = write_episode(recordings / "episodes", name)
        (init / name).mkdir(parents=True)
        write_splat(init / name / "object.ply", states[0])
    RecordingSet(recordings, "block", names[:train], names[train:]).save()
    return recordings, init
