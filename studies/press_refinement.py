"""How a held press depends on the particles' distance: `python -m studies.press_refinement`.

The same block, punch and motion, the same followed points of the surface; the block is filled as the diagnosing
engine fills what it sees.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from plop.physics.adapters.filled import EngineBase, filled_particles
from plop.physics.engine.solver import simulate
from plop.physics.scenes import find_scene
from plop.physics.scenes.motions import tool_motion
from plop.physics.scenes.scene import Scene
from plop.physics.scenes.shapes import whole_body

SPACINGS_M = 0.00736, 0.006, 0.004, 0.00267, 0.002
SEED, EPISODE, FRAME = 181, 1, 8
"""A press of the benchmark's scene, 10.3 mm deep, and the frame at which it is deepest."""
RINGS_MM = ((0, 9), (9, 11.5), (12.5, 15), (15, 19), (19, 30))
"""Distance of points from the middle of the punch, which reaches to 12.5 mm."""


def main() -> None:
    """Write the table."""
    scene = replace(Scene.read(find_scene(Path("block.toml"))), seed=SEED)
    rings = " | ".join(f"{low} to {high} mm" for low, high in RINGS_MM)
    sys.stdout.write(f"| apart [mm] | number | {rings} | force [N] |\n{'|---' * (3 + len(RINGS_MM))}|\n")
    for spacing_m in SPACINGS_M:
        count, sunk, force_n = pressed(scene, spacing_m)
        cells = " | ".join(f"{1000 * z:.2f}" for z in sunk)
        sys.stdout.write(f"| {1000 * spacing_m:.2f} | {count} | {cells} | {force_n:.1f} |\n")
        sys.stdout.flush()


def pressed(scene: Scene, spacing_m: float) -> tuple[int, list[float], float]:
    """Press once.

    Returns:
        Number of particles, mean rise of the top in each ring [m], and the force on the punch [N].
    """
    followed = whole_body(scene.shape, 0.004)
    points = followed.particles.positions[followed.surface]
    motion = tool_motion(scene.motion_plan(EPISODE), scene.shape, scene.frame_rate_hz)
    base = EngineBase(scene.material, spacing_m)
    start = filled_particles(base, (points, followed.faces), points, 0.0)
    run = simulate(start, base.material, motion, motion.times[: FRAME + 1], base.config)
    risen = (run.positions[-1] - run.positions[0])[-len(points) :, 2]
    pose = motion.world_from_tool[FRAME]
    away = np.abs((points[:, :2] - pose[:2, 3]) @ pose[:2, :2]).max(1)
    top = points[:, 2] > points[:, 2].max() - 1e-4
    sunk = [float(risen[top & (away >= low / 1000) & (away < high / 1000)].mean()) for low, high in RINGS_MM]
    return len(start) - len(points), sunk, float(-run.tool_force[-1][2])


if __name__ == "__main__":
    main()
