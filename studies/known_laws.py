"""What a law leaves of the error it makes, where everything is known: `python -m studies.known_laws`.

Episodes of the missing-physics benchmark's scene in which one law is hidden, followed without noise, at the true
material: how far the diagnosing engine is off without the law, with it at its true amplitude, and by which factor its
response would have to be multiplied to fit best. What is left cannot be blamed on the base's fit, nor on cameras:
it is the coarser grid, the other elastic law, and how the engine begins. Writes docs/results/known_laws.json and prints
its table.
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
from joblib import Parallel, delayed

from benchmarks.missing_physics.points import SCENE
from plop.comparison.engine_run import predict_points, start_particles
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import effect_type
from plop.physics.engine.material import ElasticLaw
from plop.pipeline.execute import versions
from plop.tracking.episode import Episode
from studies.discretisations import RESPONSE_EPISODES, RESPONSE_SEED, exact_episode

SPACING_M = 0.00545
"""Of the engine's particles: about 1,300, as many as `identify` takes."""
LAWS: tuple[tuple[str, dict[str, float]], ...] = (
    ("plasticity", {"softness_per_kpa": 2.5}),
    ("plasticity", {"softness_per_kpa": 5.0}),
    ("plasticity", {"softness_per_kpa": 8.0}),
    ("relaxation", {"ratio": 0.8, "tau_s": 0.03}),
    ("relaxation", {"ratio": 0.8, "tau_s": 0.1}),
    ("relaxation", {"ratio": 0.8, "tau_s": 0.8}),
    ("softening", {"loss": 0.95, "strain": 0.02}),
    ("stiffening", {"growth": 100}),
    ("swelling", {"rate_per_s": -0.2}),
    ("viscosity", {"viscosity_pa_s": 100}),
    ("fibres", {"ratio": 20, "angle_deg": 30}),
    ("adhesion", {"traction_pa": 300, "release_s": 0.1}),
    ("tilt", {"gx_m_s2": -0.8, "gy_m_s2": -3.2}),
    ("table_friction", {"d_mu": -0.3}),
    ("table_friction", {"d_mu": 0.5}),
    ("toughness", {"d_j_m2": 100}),
)


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laws", nargs="*", default=[], help="Names of laws; all by default.")
    parser.add_argument("--jobs", type=int, default=-1, help="Processes.")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="Folder with results/.")
    options = parser.parse_args()
    rows = []
    for name, values in LAWS:
        if not options.laws or name in options.laws:
            rows.append({"law": name, "values": values, **left(effect_type(name)(**values), jobs=options.jobs)})
            sys.stdout.write(f"{line(rows[-1])}\n")
            sys.stdout.flush()
    facts = {
        "command": "python -m studies.known_laws",
        "versions": versions(),
        "seeds": [RESPONSE_SEED],
        "episodes": RESPONSE_EPISODES,
        "spacing_m": SPACING_M,
        "laws": rows,
    }
    (options.out / "results" / "known_laws.json").write_text(json.dumps(facts, indent=1) + "\n")
    sys.stdout.write(table(rows) + "\n")


def left(effect: Effect, *, jobs: int = 1, episodes: int = RESPONSE_EPISODES) -> dict[str, float]:
    """Measure one law.

    Returns:
        "without_mm" and "with_mm": RMS distance over points, frames and episodes from what was followed; "factor" by
        which the law's response fits best.
    """
    base = EngineBase(replace(SCENE.material, law=ElasticLaw.NEO_HOOKEAN), SPACING_M)
    found = Parallel(n_jobs=jobs)(delayed(_one)(effect, base, k) for k in range(episodes))
    return summary(*(np.concatenate([each[k].reshape(-1, 3) for each in found]) for k in (0, 1)))


def summary(missing: np.ndarray, response: np.ndarray) -> dict[str, float]:
    """Compare what a base misses with a law's response, both [P, 3] [m]."""
    without, given = (1000 * float(np.sqrt((error**2).sum(-1).mean())) for error in (missing, missing - response))
    return {"without_mm": without, "with_mm": given, "factor": float((missing * response).sum() / (response**2).sum())}


def _one(effect: Effect, base: EngineBase, k: int) -> tuple[np.ndarray, np.ndarray]:
    """One episode: what the base misses, and the law's response, [T, P, 3] [m]."""
    seen = exact_episode(replace(SCENE, seed=RESPONSE_SEED), k, (effect,))
    plain, given = (_motion(base, seen, effects) for effects in ((), (effect,)))
    return seen.points - seen.points[:1] - plain, given - plain


def _motion(base: EngineBase, episode: Episode, effects: Sequence[Effect]) -> np.ndarray:
    points = predict_points(base, episode, start_particles(base, episode, effects), effects)
    return points - points[:1]


def line(row: dict[str, Any]) -> str:
    """Show one law."""
    values = ", ".join(f"{key} {value:g}" for key, value in row["values"].items())
    return f"| {row['law']} ({values}) | {row['without_mm']:.2f} | {row['with_mm']:.2f} | {row['factor']:.2f} |"


def table(rows: list[dict[str, Any]]) -> str:
    """Show all laws."""
    head = ["| law | without it [mm] | with it [mm] | its response fits best times |", "|---|---|---|---|"]
    return "\n".join([*head, *map(line, rows)])


if __name__ == "__main__":
    main()
