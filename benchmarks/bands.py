"""Does the 90 % band hold 90 %: `python -m benchmarks.bands [--workspace DIR]`.

Simulates recordings of a shipped scene, trains three seeds, rolls them out with a band and scores it, all by the
commands of the project; finished stages are kept in the workspace. Then the held-out episodes are dealt out again, to
validation and to test, as one deal says little: the share of points inside varies with the episodes.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.facts import machine
from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Rollouts, ScoreFiles
from plop.artifacts.store import Store
from plop.pipeline.run import run
from plop.uncertainty.band import calibrated
from plop.uncertainty.errors import PointErrors
from plop.uncertainty.scores import BandScores, score_bands

RESULT = Path(__file__).resolve().parents[1] / "docs" / "results" / "bands.json"
EPISODES, VALIDATION, TEST = 68, 28, "{scene}_04[4-9],{scene}_05?,{scene}_06?"
"""Episodes, those that choose the factor, and names of the 24 to test; each a multiple of the four kinds of motion."""
CAMERAS = {"size": 64, "count": 4}
FIT = {"count": 1000, "steps": 600, "virtual_views": 0, "held_out": 0, "render": {"depth_unit_m": 0.02, "mask": 0.3}}
UPDATE = {"update": {"iterations": 8}}
# weights are compared once, at the end: validation episodes select nothing
TRAIN: dict[str, Any] = {
    "track_steps": 500,
    "validate_every": 500,
    "image_steps": 0,
    "validation": VALIDATION,
    **UPDATE,
}


def scored(store: Store, scene: str, seeds: Sequence[int], jobs: int) -> tuple[BandScores, list[PointErrors]]:
    """Run everything; return the scores, and the errors of all held-out episodes, those of validation first."""
    alone, test = {"jobs": jobs}, TEST.format(scene=scene)
    recordings = run("simulate", store, scene=f"{scene}.toml", episodes=EPISODES, test=test, cameras=CAMERAS, **alone)
    given: dict[str, Any] = {"recordings": recordings, **alone}
    given["init"] = run("fit-init", store, **given, **FIT)
    models = [run("train", store, **given, **TRAIN, seed=seed) for seed in seeds]
    given["measured"] = run("filter", store, **given, **UPDATE, model="none")
    members = ",".join(model.address for model in models[1:])
    rollouts = run("rollout", store, **given, model=models[0], members=members)
    found = run("eval", store, **given, rollouts=rollouts, emd_every=0)
    scores = BandScores.load(found.path)
    files = [Rollouts(rollouts.path).validation(name) for name in scores.band.validation]
    files += [ScoreFiles(found.path).band_errors(name) for name in scores.episodes]
    return scores, [PointErrors.read(path) for path in files]


def dealt_again(errors: Sequence[PointErrors], validation: int, deals: int = 200) -> dict[str, Any]:
    """Calibrate on so many random episodes and score the others, many times; every tenth point is enough for that."""
    thin = [replace(e, error_m=e.error_m[:, ::10], motion_m=e.motion_m[:, ::10]) for e in errors]
    thin = [replace(e, spread_m=e.spread_m[:, ::10], counts=e.counts[:, ::10]) for e in thin]
    random, inside = np.random.default_rng(0), []
    for _ in range(deals):
        order = random.permutation(len(thin))
        band = calibrated([thin[k] for k in order[:validation]], models=3)
        scores = score_bands([thin[k] for k in order[validation:]], band, {})
        inside.append(scores.methods["widened"]["coverage"].mean)
    low, high = np.quantile(inside, [0.05, 0.95])
    return {
        "validation": validation,
        "guaranteed": band.guaranteed,
        "coverage": {"mean": float(np.mean(inside)), "low": float(low), "high": float(high), "n": deals},
    }


def main() -> int:
    """Run what is lacking and write the result."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bands", description=__doc__)
    parser.add_argument("--scene", default="block")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--workspace", "-w", type=Path, default=Path("bands"))
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    scores, errors = scored(Store(options.workspace), options.scene, options.seeds, options.jobs)
    whole = scores.to_json()
    del whole["schema"], whole["episodes"]
    result = {
        "command": "python -m benchmarks.bands",
        "machine": machine(),
        "episodes": {"simulated": EPISODES, "validation": len(scores.band.validation), "test": len(scores.episodes)},
        **whole,
        "dealt_again": [dealt_again(errors, count) for count in (4, 9, 14, 28)],
    }
    write_json(options.out, result, sort_keys=False)
    sys.stdout.write(json.dumps({key: result[key] for key in ("methods", "dealt_again")}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
