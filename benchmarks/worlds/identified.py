"""How well `identify` makes the engine follow foreign worlds: `python -m benchmarks.worlds.identified`.

Each base is a block of its own, fitted to six recordings with the defaults of the command, and compared with six more,
of other motions, on followed points, and by the force of the tool, which no fit sees. Writes
docs/results/identified.json; its other rows stay. `--bases 0` only says what the rows that are there tell of the
engine's own errors (`Parameter.model_error`).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from benchmarks.facts import machine
from benchmarks.missing_physics.makers import WORLDS, followed
from benchmarks.worlds.scene import CELLS_M
from plop.artifacts.atomic_file import write_json
from plop.comparison.discretisations import spacing_for
from plop.comparison.engine_run import start_particles
from plop.diagnosis.responses.runs import Runs
from plop.diagnosis.responses.table import Measured, Table
from plop.finite import json_ready
from plop.identification.identify import NAMES, PARTICLES, identify
from plop.parameters import NORMAL_95
from plop.physics.adapters.filled import EngineBase
from plop.physics.calibration.material_parameters import PARAMETERS
from plop.physics.engine.solver import simulate
from plop.pipeline.execute import versions
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.tracking.episode import Episode
from stages.identify.stage import FIRST_GUESS, STAGE, IdentifyConfig

RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "identified.json"
EPISODES = 6
KEYS = "world", "seed", "cells_m"


def row(world: str, seed: int, cells_m: float, jobs: int) -> dict[str, Any]:
    """Fit one base and compare it with motions that it has not seen."""
    maker = WORLDS[world](seed)
    maker.world = replace(maker.world, cells_m=cells_m)
    sequences = [maker.sequence(k, {}) for k in range(EPISODES)]
    fitted = [followed(sequence, k) for k, sequence in enumerate(sequences)]
    start = EngineBase(FIRST_GUESS, spacing_for(fitted, PARTICLES), True)
    began = time.perf_counter()
    base, found = identify(fitted, start, NAMES, iterations=IdentifyConfig().iterations, jobs=jobs)
    seconds = time.perf_counter() - began
    unseen = [maker.episode(EPISODES + k, {}) for k in range(EPISODES)]
    return {
        "world": world,
        "seed": seed,
        "cells_m": cells_m,
        "identify_version": STAGE.version,
        "declared": maker.declared,
        "estimates": {name: estimate.to_json() for name, estimate in found.estimates.items()},
        "model_errors": {name: PARAMETERS[name].model_error for name in NAMES},
        "fitted": misses(fitted, base, jobs),
        "unseen": misses(unseen, base, jobs),
        "forces": forces(sequences, fitted, base),
        "seconds": round(seconds, 1),
        "engine_runs": found.rollouts,
    }


def misses(episodes: list[Episode], base: EngineBase, jobs: int) -> dict[str, Any]:
    """RMS of what is compared: the error, how far things move, and the noise in it [mm]; errors of each episode."""
    evidence = Table(Measured(episodes), base, Runs(None, jobs=jobs)).evidence
    rms = [1000 * float(np.sqrt((e.residual**2).sum(-1).mean())) for e in evidence]
    moved = [1000 * float(np.sqrt(((e.residual + e.predicted) ** 2).sum(-1).mean())) for e in evidence]
    noise = [1000 * float(np.sqrt(3 * (e.noise_m**2).mean())) for e in evidence]
    parts = {"rms_mm": rms, "moved_mm": moved, "noise_mm": noise}
    return {**{name: float(np.sqrt(np.mean(np.square(part)))) for name, part in parts.items()}, "episodes_mm": rms}


def forces(sequences: Sequence[MeshSequence], episodes: Sequence[Episode], base: EngineBase) -> dict[str, float]:
    """Compare the force of the tool: median of presses, engine over world, and the largest lateral share in drags."""
    presses, drags = [], []
    for sequence, episode in zip(sequences, episodes, strict=True):
        config = replace(base.config, table_z_m=episode.table_z_m)
        run = simulate(start_particles(base, episode), base.material, episode.tool, episode.times, config)
        both = np.stack([np.array(sequence.facts["tool_force_n"]), run.tool_force])
        down = np.maximum(-both[..., 2], 1e-9)
        pressed = down[0] > 0.8 * down[0].max()
        if sequence.facts["motion"]["kind"] == "press":
            presses.append(float(np.median(down[1, pressed] / down[0, pressed])))
        if sequence.facts["motion"]["kind"] == "drag":
            drags.append((np.linalg.norm(both[..., :2], axis=-1) / down)[:, pressed].max(1))
    world, engine = np.mean(drags, 0)
    return {"press_ratio": float(np.median(presses)), "drag_share": float(world), "engine_drag_share": float(engine)}


def model_errors(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Estimate the scatter of fits about declared values, beyond their own statistical errors.

    Maximum likelihood with normal errors, mean zero. Both frictions are one kind: the same law in the engine, and twice
    as many fits.

    Returns:
        For each kind: the standard deviation, in the units that are fitted (the logarithm of a stiffness), and the
        number of fits.
    """
    kinds: dict[str, list[tuple[float, float]]] = {}
    for each in rows:
        for name, declared in each["declared"].items():
            parameter, fit = PARAMETERS[name], each["estimates"][name]
            low, value, high, true = (parameter.encode(x) for x in (fit["low"], fit["value"], fit["high"], declared))
            contained = each.get("model_errors", {}).get(name, 0.0)
            half = max(high - value, value - low)  # the other end may lie at a bound
            statistical = max((half / NORMAL_95) ** 2 - contained**2, 0.0)
            kinds.setdefault("friction" if name.endswith("friction") else name, []).append((value - true, statistical))
    return {kind: {"error": _beyond(*np.array(fits).T), "n": len(fits)} for kind, fits in kinds.items()}


def _beyond(errors: np.ndarray, variances: np.ndarray) -> float:
    def surprise(extra: float) -> float:
        total = variances + extra**2
        return float((errors**2 / total + np.log(total)).sum())

    most = 3 * float(np.abs(errors).max()) + 1e-9
    return float(minimize_scalar(surprise, bounds=(1e-6 * most, most), method="bounded").x)


def main() -> None:
    """Measure and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", default="mujoco,drake", help="some of mujoco, drake")
    parser.add_argument("--first-seed", type=int, default=7950)
    parser.add_argument("--bases", type=int, default=3, help="bases in each world")
    parser.add_argument("--cells-mm", type=float, help="edge of the cells of the world's mesh; else the benchmark's")
    parser.add_argument("--jobs", type=int, default=-1, help="processes; -1: one for each core")
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    rows = json.loads(options.out.read_text())["rows"] if options.out.is_file() else []
    for k in range(options.bases):
        for world in options.worlds.split(","):
            cells_m = CELLS_M[world] if options.cells_mm is None else options.cells_mm / 1000
            new = row(world, options.first_seed + k, cells_m, options.jobs)
            rows = [each for each in rows if any(each[key] != new[key] for key in KEYS)] + [new]
            facts = {
                "command": "python -m benchmarks.worlds.identified",
                "versions": versions(),
                "machine": machine(),
                "seeds": sorted({each["seed"] for each in rows}),
                "rows": rows,
            }
            write_json(options.out, json_ready(facts), sort_keys=False)
            sys.stdout.write(
                f"{world} {new['seed']}: unseen {new['unseen']['rms_mm']:.2f} mm, {new['seconds']:.0f} s\n"
            )
            sys.stdout.flush()
    for kind, found in model_errors(rows).items():
        sys.stdout.write(f"{kind}: error of the engine {found['error']:.2f} ({found['n']} fits)\n")


if __name__ == "__main__":
    main()
