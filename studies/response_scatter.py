"""How an object's response differs from the engine's, from motion to motion: `python -m studies.response_scatter`.

Worlds of the benchmark of missing physics (plop's engine with other particles and another elastic law, MuJoCo, Drake),
the engine fitted to the recordings of each without a change; one law at a time is changed, at a known amplitude. A
motion's factor is the multiple of the engine's response that fits the world's best. `sd` are standard deviations of
factors over a law's mean factor: of motions of one kind, of kinds, and of laws. Writes
docs/results/response_scatter.json.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.missing_physics.makers import WORLDS
from benchmarks.missing_physics.points import Points
from plop.artifacts.atomic_file import write_json
from plop.comparison.engine_run import run_points, start_particles
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import effect_type
from plop.pipeline.execute import versions
from plop.statistics.bootstrap import bootstrap_interval
from plop.tracking.episode import Episode
from plop.tracking.phases import motion_kind

PARTICLES = 400
LEAST_M = 2e-4
"""RMS displacement from which on a law has a response [m]."""
MOTIONS = {"own": 6, "mujoco": 9, "drake": 9}
"""Three of each kind."""


def main() -> None:
    """Compare and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-responses"), help="Workspace.")
    parser.add_argument("--worlds", nargs="+", choices=list(WORLDS), default=["own", "mujoco"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[7974])
    parser.add_argument("--jobs", type=int, default=-1, help="Processes that fit the engine.")
    parser.add_argument("--out", type=Path, default=Path("docs/results/response_scatter.json"))
    options = parser.parse_args()
    points, rows = Points(options.work, options.jobs, PARTICLES), []
    for world in options.worlds:
        for seed in options.seeds:
            maker = WORLDS[world](seed)
            base, _ = points.base(world, seed, maker)
            for law in maker.laws:
                row = compared(maker, base, law, MOTIONS[world])
                if row is not None:
                    rows.append({"world": world, "seed": seed, "law": law, **row})
                    sys.stdout.write(f"{rows[-1]}\n")
                    sys.stdout.flush()
    facts = {
        "command": f"python -m studies.response_scatter --worlds {' '.join(options.worlds)}"
        f" --seeds {' '.join(map(str, options.seeds))}",
        "versions": versions(),
        "seeds": options.seeds,
        "sd": {world: spread([r for r in rows if r["world"] == world]) for world in options.worlds}
        | {"all": spread(rows)},
        "rows": rows,
    }
    write_json(options.out, facts, sort_keys=False)


def compared(maker: Any, base: EngineBase, law: str, count: int) -> dict[str, Any] | None:
    """Compare the responses to a law in some motions; None where it has none, or cannot be run."""
    values, found = maker.drawn(law, np.random.default_rng([count, len(law)]), 2.0)
    kind = effect_type(law)
    effect = kind(**{**{k: v for k, v in values.items() if k in {p.name for p in kind.shapes}}, **found[law]})
    rows = []
    try:
        for k in range(count):
            plain, changed = maker.episode(k, {}), maker.episode(k, {law: values})
            rows.append((motion_kind(plain), *fitted(displaced(changed, plain), response(base, plain, effect))))
    except PlopError as error:
        sys.stdout.write(f"{law}: {error.problem}\n")
        return None
    if min(row[3] for row in rows) < LEAST_M:
        return None
    kinds, factors, cosines, _ = zip(*rows, strict=True)
    return {"kinds": kinds, "factors": np.round(factors, 3).tolist(), "cosines": np.round(cosines, 3).tolist()}


def displaced(changed: Episode, plain: Episode) -> np.ndarray:
    """What a law does in the world, [T, M, 3] [m]: both were followed with the same noise."""
    return np.asarray(changed.points - plain.points)


def response(base: EngineBase, episode: Episode, effect: Effect) -> np.ndarray:
    """What it does in the engine, [T, M, 3] [m]."""
    runs = [run_points(base, episode, start_particles(base, episode, e), e, np.inf)[0] for e in ([effect], [])]
    return np.asarray(runs[0] - runs[1])


def fitted(world: np.ndarray, engine: np.ndarray) -> tuple[float, float, float]:
    """Give the engine's best factor, the cosine, and the RMS displacement in the world [m]."""
    both, own = float((world * engine).sum()), float((engine**2).sum())
    size = float((world**2).sum())
    return both / max(own, 1e-30), both / max(np.sqrt(own * size), 1e-30), float(np.sqrt((world**2).sum(-1).mean()))


def spread(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Parts of the variance of factors: within kinds of motion, between kinds, between laws (analysis of variance)."""
    within, between, means = list[float](), list[float](), list[float]()
    for row in rows:
        factors, kinds = np.array(row["factors"]), np.array(row["kinds"])
        mean = float(factors.mean())
        groups = [factors[kinds == kind] / mean for kind in dict.fromkeys(row["kinds"])]
        own = float(np.mean([g.var(ddof=1) for g in groups]))
        count = float(np.mean([len(g) for g in groups]))
        within.append(own)
        between.append(float(np.var([g.mean() for g in groups], ddof=1)) - own / count)
        means.append(mean)
    cosines = [c for row in rows for c in row["cosines"]]
    return {
        "n": len(rows),
        "within_kind": _sd(within),
        "between_kinds": _sd(between),
        "laws": round(float(np.std(means, ddof=1)), 3) if len(means) > 1 else None,
        "mean": round(float(np.mean(means)), 3),
        "cosine": [round(float(np.quantile(cosines, q)), 3) for q in (0.5, 0.05, 0.95)],
    }


def _sd(variances: list[float]) -> dict[str, float | None]:
    """Root of the mean variance, with its 95 % interval over laws, and of the median, which a law that slips leaves."""
    found = bootstrap_interval(variances)
    assert found is not None
    values = {"mean": found.mean, "low": found.low, "high": found.high, "median": float(np.median(variances))}
    return {name: None if v is None else round(float(np.sqrt(max(v, 0.0))), 3) for name, v in values.items()}


if __name__ == "__main__":
    main()
