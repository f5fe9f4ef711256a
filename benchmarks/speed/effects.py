"""Measure what every effect does and costs: `python -m benchmarks.speed.effects [NAME ...]`.

Runs the demo's block through 4 of its cut-and-push motions with and without each effect, and writes
docs/results/effects.json.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from plop.parameters import Parameter
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import library

RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "effects.json"
COMMAND = "python -m benchmarks.speed.effects"
PLANS = 4
SPACING_M = 0.005
STEP_S = 3.5e-4
"""Fixed, because a different time step alone moves the object by some hundredths of a millimetre."""
Figures = dict[str, Any]


def positions(effects: list[Effect], dt_s: float = STEP_S) -> tuple[np.ndarray, float]:
    """Run the first motions of the demo.

    Returns:
        Positions, all episodes and frames in one array [K, 3] [m]; least processor time of a time step, over
        the episodes [s].
    """
    from plop.physics.engine.config import EngineConfig
    from plop.physics.engine.solver import simulate
    from plop.physics.scenes.demo import BLOCK_M, MATERIAL, blade_motion, draw_plan
    from plop.physics.scenes.shapes import Shape, halved_body

    shape = Shape("block", (float(BLOCK_M[0]), float(BLOCK_M[1]), float(BLOCK_M[2])))
    config = EngineConfig(dx_m=2 * SPACING_M, dt_s=dt_s)
    parts, costs = [], []
    for k in range(PLANS):
        plan = draw_plan(np.random.default_rng([0, k]))
        body, motion = halved_body(shape, SPACING_M, plan.offset_m, plan.yaw_rad), blade_motion(plan)
        started = time.process_time()
        run = simulate(body.particles, MATERIAL, motion, motion.times, config, effects=effects)
        costs.append((time.process_time() - started) / run.steps)
        parts.append(run.positions.reshape(-1, 3))
    return np.concatenate(parts), min(costs)


def rms_mm(difference: np.ndarray) -> float:
    """Root mean square length of displacements [K, 3] [m], in mm."""
    return float(1e3 * np.sqrt((difference**2).sum(1).mean()))


def keys() -> dict[str, tuple[type[Effect], Parameter, Figures]]:
    """Name every row of the table: effect, amplitude and setting of the shape parameters."""
    return {
        " ".join([f"{name}.{p.name}", *(f"{k}={v:g}" for k, v in shape.items())]): (effect, p, shape)
        for name, effect in library().items()
        for p in effect.amplitudes
        for shape in effect.variants
    }


def measure(names: list[str]) -> None:
    """Measure the effects of these names (all without names); each figure is saved as soon as it is known."""
    positions([])  # compiles the kernels
    base, step_s = positions([])
    other, _ = positions([], dt_s=0.9 * STEP_S)
    load = round(os.getloadavg()[0], 1)
    result: Figures = {
        "command": COMMAND,
        "what": "RMS over particles, frames and 4 cut-and-push motions of the demo's block, particles 5 mm apart",
        "dt_s": STEP_S,
        "load_1min": load,
        "shorter_step_mm": round(rms_mm(other - base), 4),
        "step_ms": round(1e3 * step_s, 3),
        "particles": len(base) // PLANS // 22,
        "effects": {},
    }
    if names and RESULT.is_file():  # the figures without effects belong to the other rows
        result = json.loads(RESULT.read_text(encoding="utf-8"))
        result["effects"] = {key: figure for key, figure in result["effects"].items() if key in keys()}
        result["later"] = result.get("later", {}) | dict.fromkeys(names, load)
    for key, (effect, parameter, shape) in keys().items():
        if not names or effect.name in names:
            result["effects"][key] = _response(effect, parameter, shape, base, step_s)
            sys.stdout.write(f"{key:45s} {result['effects'][key]}\n")
            sys.stdout.flush()
            RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def _response(effect: type[Effect], parameter: Parameter, shape: Figures, base: np.ndarray, step_s: float) -> Figures:
    def moved(amplitude: float) -> tuple[np.ndarray, float]:
        there, seconds = positions([effect(**{parameter.name: amplitude, **shape})])
        return there - base, seconds

    typical, _ = moved(parameter.typical)
    one, cost_s = moved(parameter.step)
    two, other_s = moved(2 * parameter.step)
    return {
        "step_mm": round(rms_mm(one), 4),
        "curved": round(rms_mm(two - 2 * one) / max(rms_mm(two), 1e-9), 3),
        "typical_mm": round(rms_mm(typical), 3),
        "cost": round(min(cost_s, other_s) / step_s - 1, 2),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="these effects only")
    options = parser.parse_args()
    if unknown := {*options.names} - {*library()}:
        parser.error(f"no effect is called {', '.join(sorted(unknown))}; there are {', '.join(library())}")
    measure(options.names)
