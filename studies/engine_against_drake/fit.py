"""Fit the engine to ideal tracks of a foreign world: `python studies/engine_against_drake/fit.py drake`.

Unmaintained. Records three episodes of one block (cells of 6.7 mm in Drake, 5 mm in MuJoCo) and fits five parameters.
"""

# ruff: noqa
import importlib
import sys
import time
from dataclasses import replace

from benchmarks.worlds.scene import Motion, World
from plop.comparison.discretisations import spacing_for
from plop.identification.identify import NAMES, PARTICLES, identify
from plop.physics.adapters.filled import EngineBase
from plop.physics.engine.material import Material
from plop.tracking.episode import episode_from_sequence

MOTIONS = [
    Motion("press", depth_m=0.007, x_m=0.004),
    Motion("push", aside_m=0.014, yaw_rad=0.2),
    Motion("drag", depth_m=0.004, yaw_rad=0.4, aside_m=0.012),
]


def main() -> None:
    """Record, fit, print."""
    record = importlib.import_module(f"benchmarks.worlds.{sys.argv[1]}").record
    fine = {"drake": (0.0067, 0.005), "mujoco": (0.005, 0.002)}[sys.argv[1]]
    world = replace(World(), cells_m=fine[0], time_step_s=fine[1])
    episodes = [episode_from_sequence(record(world, motion), noise_m=1e-4) for motion in MOTIONS]
    material = Material(1.2e4, 0.4, damping_per_s=2.0, table_friction=0.4, tool_friction=0.3, table_slip_m_s=0.003)
    begun = time.process_time()
    base = EngineBase(material, spacing_for(episodes, PARTICLES), True)
    _, found = identify(episodes, base, NAMES, iterations=5, jobs=1)
    print(f"{found.rollouts} runs, {time.process_time() - begun:.0f} s, {1000 * found.rms_after_m:.3f} mm")
    for name, e in found.estimates.items():
        print(name, f"{e.value:.4g} ({e.low:.3g} to {e.high:.3g})")


main()
