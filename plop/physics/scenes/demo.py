"""The demo's recordings: a soft block is cut in two, and one half is pushed away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.solver import simulate
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.as_sequence import as_sequence
from plop.physics.scenes.motions import led_along
from plop.physics.scenes.shapes import Shape, halved_body
from plop.physics.scenes.tools import blade_mesh
from plop.recordings.readers.mesh.sequence import MeshSequence, write_mesh_sequence

BLOCK_M = np.array([0.080, 0.050, 0.040])
"""Length, width and height of the block [m]; it stands on the table z = 0 around the origin."""
MATERIAL = Material(
    youngs_modulus_pa=1.5e4,
    poisson=0.42,
    density_kg_m3=1050.0,
    damping_per_s=2.0,
    table_friction=0.5,
    tool_friction=0.3,
    toughness_j_m2=2.0,
)
DEMO_TRAIN, DEMO_TEST = 4, 2
_SPACING_M = 0.004
_FRAMES = 22


@dataclass(frozen=True)
class CutPlan:
    """Motion of the blade in one episode."""

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
        folder: Where to write; created when it does not exist.
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
    length, width, height = (float(size) for size in BLOCK_M)
    block = halved_body(Shape("block", (length, width, height)), _SPACING_M, plan.offset_m, plan.yaw_rad)
    motion = blade_motion(plan)
    run = simulate(block.particles, MATERIAL, motion, motion.times, EngineConfig(dx_m=2 * _SPACING_M))
    facts = {
        "plan": {key: float(value) for key, value in vars(plan).items()},
        "material": {key: float(value) for key, value in vars(MATERIAL).items()},
        "spacing_m": _SPACING_M,
    }
    return as_sequence(name, "block", block, motion, run, facts)


def blade_motion(plan: CutPlan) -> ToolMotion:
    """Move the blade down through the block and, after a short rest, sideways along its normal."""
    top, bottom = BLOCK_M[2] + 0.004, -0.006
    normal = np.array([np.cos(plan.yaw_rad), np.sin(plan.yaw_rad), 0.0])
    down = (top - bottom) / plan.speed_m_s
    rest = down + 0.04
    end = rest + abs(plan.push_m) / plan.push_speed_m_s
    over = np.array([plan.offset_m, 0, 0])
    through = over + [0, 0, bottom]
    path = np.stack([over + [0, 0, top], through, through, through + plan.push_m * normal])
    times = np.linspace(0, end, _FRAMES)
    return ToolMotion(*blade_mesh(), times, led_along(np.array([0, down, rest, end]), path, plan.yaw_rad, times))
