"""What the mean over discretisations is worth: `python -m studies.discretisations --work W`.

The engine of the missing-physics benchmark (`benchmarks.missing_physics`, its folder --work) predicts fresh episodes of
each kind of motion, in which nothing is hidden, and responds to a few hidden laws: by itself, and as the mean over its
discretisations. No noise; the truth is the finer simulation. Writes docs/results/discretisations.json.
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

from benchmarks.missing_physics.points import PARTICLES, SCENE, fitted_engine
from benchmarks.missing_physics.response import response_error
from plop.comparison.discretisations import OTHERS, discretised
from plop.diagnosis.responses.runs import Runs
from plop.diagnosis.responses.table import Measured, Table
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import effect_type
from plop.physics.scenes.scene import Scene, simulate_episode
from plop.pipeline.execute import versions
from plop.tracking.episode import Episode, episode_from_sequence

KINDS = ("push", "hold", "cut-push", "cycles")
SEED, RESPONSE_SEED, RESPONSE_EPISODES = 9000, 9001, 4
LAWS: tuple[tuple[str, dict[str, float]], ...] = (
    ("swelling", {"rate_per_s": 0.1}),
    ("table_friction", {"d_mu": -0.35}),
    ("table_friction", {"d_mu": 0.9}),
    ("plasticity", {"softness_per_kpa": 1.5, "hardening": 0.1}),
    ("fibres", {"ratio": 50, "angle_deg": 30}),
    ("adhesion", {"traction_pa": 265, "release_s": 0.1}),
    ("toughness", {"d_j_m2": 114}),
    ("viscosity", {"viscosity_pa_s": 100}),
)


def main() -> None:
    """Measure and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-physics"), help="Holds the engine.")
    parser.add_argument("--particles", type=int, default=PARTICLES, help="Of the diagnosing engine.")
    parser.add_argument("--episodes", type=int, default=12, help="Of each kind of motion.")
    parser.add_argument("--jobs", type=int, default=-1, help="Processes.")
    parser.add_argument("--out", type=Path, default=Path("docs/results/discretisations.json"))
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    members = discretised(fitted_engine(options.work, options.jobs, options.particles))
    runs = Runs(options.work / "jobs", jobs=options.jobs)
    command = f"python -m studies.discretisations --particles {options.particles} --episodes {options.episodes}"
    facts: dict[str, Any] = {
        "command": command,
        "versions": versions(),
        "seeds": [SEED, RESPONSE_SEED],
        "spacings": [1.0, *OTHERS],
        "predictions": {},
        "responses": [],
    }
    for kind in KINDS:
        found = predictions(exact(kind, options.episodes, options.jobs), members[0], runs)
        facts["predictions"][kind] = found
        _tell(kind, found)
    for name, values in LAWS:
        row = {"law": name, "values": values, **responses(effect_type(name)(**values), members, runs, options.jobs)}
        facts["responses"].append(row)
        _tell(name, row)
    options.out.write_text(json.dumps(facts, indent=1))


def exact(kind: str, count: int, jobs: int) -> list[Episode]:
    """Simulate episodes of one kind of motion and follow points of their surface without noise."""
    scene = replace(SCENE, motions=(kind,), seed=SEED)
    return list(Parallel(n_jobs=jobs)(delayed(exact_episode)(scene, k, ()) for k in range(count)))


def exact_episode(scene: Scene, k: int, effects: Sequence[Effect]) -> Episode:
    """Simulate one episode and follow points of its surface without noise."""
    return episode_from_sequence(simulate_episode(scene, k, effects), noise_m=0.0, seed=k)


def predictions(episodes: list[Episode], base: EngineBase, runs: Runs) -> dict[str, float]:
    """Compare the engine by itself and the mean with the truth.

    Returns:
        "alone_mm", "mean_mm": RMS over episodes of the patches' error, and "alone_worst_mm", "mean_worst_mm" its
        largest in an episode; "spread_mm": RMS length of the standard deviation between discretisations;
        "correlation" of that with the mean's error over patches and frames, of logarithms.
    """
    errors, spreads, cells = [], [], []
    for episode in episodes:
        said = Table(Measured([episode]), base, runs).predictions[0]
        moved = np.stack([_motion(episode, points) for points in said])[:, 1:]
        wrong = moved - episode.motion[1:]
        errors.append([_rms_mm(wrong[0]), _rms_mm(wrong.mean(0))])
        spread = np.sqrt(moved.var(0, ddof=1).sum(-1))
        spreads.append(1000 * float(np.sqrt((spread**2).mean())))
        cells.append(np.stack([spread.ravel(), np.linalg.norm(wrong.mean(0), axis=-1).ravel()]))
    alone, mean = np.array(errors).T
    both = np.log(np.maximum(np.concatenate(cells, 1), 1e-6))
    return {
        "alone_mm": _root(alone),
        "mean_mm": _root(mean),
        "alone_worst_mm": float(alone.max()),
        "mean_worst_mm": float(mean.max()),
        "spread_mm": _root(np.array(spreads)),
        "correlation": float(np.corrcoef(both)[0, 1]),
        "episodes": len(episodes),
    }


def responses(effect: Effect, members: list[EngineBase], runs: Runs, jobs: int) -> dict[str, Any]:
    """Compare the response to one law with the true one; see `response_error`."""
    scene = replace(SCENE, seed=RESPONSE_SEED)
    parallel, numbers = Parallel(n_jobs=jobs), range(RESPONSE_EPISODES)
    hidden, plain = (
        list(parallel(delayed(exact_episode)(scene, k, effects) for k in numbers)) for effects in ((effect,), ())
    )
    return {
        "alone": response_error(effect, hidden, plain, members[:1], runs),
        "mean": response_error(effect, hidden, plain, members, runs),
    }


def _motion(episode: Episode, points: np.ndarray) -> np.ndarray:
    return episode.pooled(points - points[:1])


def _rms_mm(error: np.ndarray) -> float:
    return 1000 * float(np.sqrt((error**2).sum(-1).mean()))


def _root(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def _tell(name: str, found: dict[str, Any]) -> None:
    sys.stdout.write(f"{name}: {found}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
