"""The recordings that the project makes for itself: a soft block is cut in two, one half is pushed away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plop.physics.config import EngineConfig
from plop.physics.lattice import lattice, surface_vertices
from plop.physics.material import Material
from plop.physics.particles import Particles
from plop.physics.solver import EngineTrajectory, simulate
from plop.physics.tool_motion import ToolMotion
from plop.recordings.mesh_sequence import MeshSequence, write_mesh_sequence

BLOCK_M = np.array([0.080, 0.050, 0.040])
"""Length, width and height of the block [m]; it stands on the table z = 0 around the origin."""
MATERIAL = Material(youngs_modulus_pa=1.5e4, poisson=0.42, density_kg_m3=1050.0, damping_per_s=2.0,
                    table_friction=0.5, tool_friction=0.3, toughness_j_m2=2.0)  # fmt: skip
DEMO_TRAIN, DEMO_TEST = 4, 2
_SPACING_M = 0.004
_FRAMES = 22


@dataclass(frozen=True)
class CutPlan:
    """How the blade moves in one episode."""

    offset_m: float
    """Where the cut crosses the block's middle, along x [m]."""
    yaw_rad: float
    """Turn of the blade about the vertical; at 0 its normal is x [rad]."""
    speed_m_s: float
    """Speed of the descent [m/s]."""
    push_m: float
    """Path of the sideways push along the blade's normal; its sign chooses the half [m]."""
    push_speed_m_s: float
    """Speed of the push [m/s]."""


def make_demo_recordings(
    folder: Path, *, seed: int = 0, progress: Callable[[int, int, str], None] = lambda done, total, label: None
) -> None:
    """Simulate the demo's episodes and write them as mesh sequences `demo_000`, `demo_001`, ...

    The first DEMO_TRAIN are meant for training, the DEMO_TEST after them for tests. The same seed gives
    the same files.

    Args:
        folder: Where to write; made when it does not exist.
        seed: Draws positions, speeds and directions.
        progress: Called after each episode with (done, total, label).
    """
    total = DEMO_TRAIN + DEMO_TEST
    for k in range(total):
        write_mesh_sequence(folder, demo_episode(f"demo_{k:03d}", draw_plan(np.random.default_rng([seed, k]))))
        progress(k + 1, total, f"demo_{k:03d}")


def draw_plan(generator: np.random.Generator) -> CutPlan:
    """Draw one episode's motion."""
    draw = generator.uniform
    return CutPlan(
        offset_m=draw(-0.012, 0.012),
        yaw_rad=np.deg2rad(draw(-15, 15)),
        speed_m_s=draw(0.08, 0.12),
        push_m=float(generator.choice([-1, 1])) * draw(0.018, 0.026),
        push_speed_m_s=draw(0.06, 0.08),
    )


def demo_episode(name: str, plan: CutPlan) -> MeshSequence:
    """Simulate one episode."""
    block = _Block(plan)
    motion = blade_motion(plan)
    config = EngineConfig(dx_m=2 * _SPACING_M)
    run = simulate(block.particles, MATERIAL, motion, motion.times, config)
    return _as_sequence(name, plan, block, motion, run)


class _Block:
    """Both halves of the block as lattices that meet in the plane of the coming cut."""

    def __init__(self, plan: CutPlan) -> None:
        positions, volumes, sides, faces, cut = [], [], [], [], []
        half, start = BLOCK_M / 2, 0
        for sign in (-1, 1):
            length = half[0] + sign * -plan.offset_m
            counts = [max(2, round(size / _SPACING_M)) for size in (length, BLOCK_M[1], BLOCK_M[2])]
            grid = lattice((counts[0], counts[1], counts[2]))
            u, y, z = (grid.parameters * [1, *BLOCK_M[1:]] - [0, BLOCK_M[1] / 2, 0]).T
            plane = plan.offset_m - np.tan(plan.yaw_rad) * y
            low, high = (-half[0], plane) if sign < 0 else (plane, half[0])
            positions.append(np.stack([low + u * (high - low), y, z], 1))
            volumes.append(grid.weights * (high - low) * BLOCK_M[1] * BLOCK_M[2])
            sides.append(np.full(len(u), sign))
            faces.append(grid.faces + start)
            cut.append(grid.face_of == (1 if sign < 0 else 0))
            start += len(u)
        self.surface, self.faces = surface_vertices(np.concatenate(faces))
        self.cut_faces = np.concatenate(cut)
        self.particles = Particles(np.concatenate(positions), np.concatenate(volumes), sides=np.concatenate(sides),
                                   radii=np.zeros(start))  # fmt: skip


def blade_mesh(height_m: float = 0.040, length_m: float = 0.150, edge_m: float = 8e-5, spine_m: float = 0.002
               ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Build a straight blade: edge at z = 0, spine above, normal x, length along y.

    Returns:
        Vertices [8, 3] [m] and outward triangles [12, 3].
    """
    grid = lattice((1, 1, 1))
    u, v, w = grid.parameters.T
    vertices = np.stack([(u - 0.5) * (edge_m + w * (spine_m - edge_m)), (v - 0.5) * length_m, w * height_m], 1)
    return vertices, grid.faces


def blade_motion(plan: CutPlan) -> ToolMotion:
    """Lead the blade down through the block and, after a short rest, sideways along its normal."""
    top, bottom = BLOCK_M[2] + 0.004, -0.006
    normal = np.array([np.cos(plan.yaw_rad), np.sin(plan.yaw_rad), 0.0])
    down = (top - bottom) / plan.speed_m_s
    rest = down + 0.04
    end = rest + abs(plan.push_m) / plan.push_speed_m_s
    times = np.linspace(0, end, _FRAMES)
    height = np.clip(top - times * plan.speed_m_s, bottom, None)
    aside = np.clip(times - rest, 0, None) * plan.push_speed_m_s * np.sign(plan.push_m)
    poses = np.tile(np.eye(4), (_FRAMES, 1, 1))
    cos, sin = normal[:2]
    poses[:, :2, :2] = [[cos, -sin], [sin, cos]]
    poses[:, :3, 3] = [plan.offset_m, 0, 0] + aside[:, None] * normal + height[:, None] * [0, 0, 1]
    return ToolMotion(*blade_mesh(), times, poses)


def _as_sequence(name: str, plan: CutPlan, block: _Block, motion: ToolMotion, run: EngineTrajectory) -> MeshSequence:
    facts = {
        "plan": {key: float(value) for key, value in vars(plan).items()},
        "material": {key: float(value) for key, value in vars(MATERIAL).items()},
        "spacing_m": _SPACING_M,
    }
    return MeshSequence(
        name=name,
        environment="block",
        times=run.times,
        vertices=run.positions[:, block.surface].astype(np.float64),
        faces=block.faces,
        tool_vertices=motion.vertices,
        tool_faces=motion.faces,
        world_from_tool=motion.world_from_tool,
        table_z_m=0.0,
        rest_vertices=block.particles.positions[block.surface],
        cut_faces=block.cut_faces,
        source="particle-grid engine",
        facts=facts,
    )
