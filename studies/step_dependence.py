"""How much the engine depends on its time step: `python -m studies.step_dependence`.

A free block of 12 x 10 x 8 particles swings in its first stretching and bending modes; a block is pressed and pushed.
Every transfer to the grid and back takes from motion that the grid cannot hold, so that more steps take more.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from plop.diagnosis.responses.hypotheses import candidates_of
from plop.physics.adapters.filled import EngineBase, filled_particles
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import library
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.physics.scenes import find_scene
from plop.physics.scenes.motions import tool_motion
from plop.physics.scenes.scene import Scene
from plop.physics.scenes.shapes import whole_body

COURANT = 0.4, 0.2, 0.1, 0.05
SEED, EPISODES, SPACING_M = 181, (0, 1, 2), 0.006
DX_M = 0.01


def main() -> None:
    """Write the tables."""
    say = sys.stdout.write
    say("| courant | stretching decays [1/s] | bending decays [1/s] |\n|---|---|---|\n")
    for courant in COURANT:
        say(f"| {courant} | {decay_per_s(1, courant):.1f} | {decay_per_s(2, courant):.1f} |\n")
    say("\n| law | times shorter steps | response [mm] | of which steps alone [mm] |\n|---|---|---|---|\n")
    for name in ("adhesion", "cohesion", "fibres", "stiffening", "layered", "viscosity"):
        candidate = next(c for c in candidates_of(library()) if c.effect == name)
        column = candidate.columns[0]
        effect = column.build(library(), column.levels[min(1, len(column.levels) - 1)])
        shorter, response, alone = steps_alone(effect)
        say(f"| {effect!r} | {shorter:.1f} | {1000 * response:.2f} | {1000 * alone:.2f} |\n")
        sys.stdout.flush()


def decay_per_s(mode: int, courant: float) -> float:
    """Let a free bar without damping swing along x (mode 1) or bend (mode 2), and measure how fast it comes to rest."""
    axes = [(np.arange(n) + 0.5) * DX_M / 2 for n in (12, 10, 8)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    shape = np.cos(mode * np.pi * x[:, 0] / (6 * DX_M))
    v = np.zeros_like(x)
    v[:, 0 if mode == 1 else 2] = 0.05 * (shape - shape.mean())
    particles = Particles(x, np.full(len(x), (DX_M / 2) ** 3), velocities=v)
    config = EngineConfig(dx_m=DX_M, gravity_m_s2=(0, 0, 0), table_z_m=None, courant=courant)
    times = np.linspace(0, 0.4, 161)
    run = simulate(particles, Material(1.2e4, 0.4, damping_per_s=0), None, times, config)
    swing = ((run.positions - x) * v).sum((1, 2))
    peaks = [k for k in range(1, 160) if abs(swing[k - 1]) < abs(swing[k]) >= abs(swing[k + 1])][:8]
    return -float(np.polyfit(times[peaks], np.log(np.abs(swing[peaks])), 1)[0])


def steps_alone(effect: Effect) -> tuple[float, float, float]:
    """Compare a law's response with what the base changes in the law's time steps, RMS over three motions [m]."""
    scene = replace(Scene.read(find_scene(Path("block.toml"))), seed=SEED)
    followed = whole_body(scene.shape, 0.004)
    points, base = followed.particles.positions[followed.surface], EngineBase(scene.material, SPACING_M)
    start = filled_particles(base, (points, followed.faces), points, 0.0)
    config = replace(base.config, table_z_m=0.0)
    squares, shorter = [], []
    for k in EPISODES:
        tool = tool_motion(scene.motion_plan(k), scene.shape, scene.frame_rate_hz)
        plain, law = (simulate(start, base.material, tool, tool.times, config, effects=e) for e in ((), (effect,)))
        same = simulate(start, base.material, tool, tool.times, replace(config, dt_s=law.dt_s))
        moved = [(run.positions - plain.positions)[:, -len(points) :] for run in (law, same)]
        squares.append([(m**2).sum(-1).mean() for m in moved])
        shorter.append(plain.dt_s / law.dt_s)
    return float(np.mean(shorter)), *np.sqrt(np.mean(squares, 0)).tolist()


if __name__ == "__main__":
    main()
