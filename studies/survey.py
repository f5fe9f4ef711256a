"""What laws change in an engine of few particles, against one of more: `python -m studies.survey --work W`.

`diagnose` runs all laws with few particles first. Each law, at all amplitudes at which it is tried, moves the objects of
two worlds of the missing-physics benchmark in six motions each (those of Drake are those of MuJoCo); the two responses
are compared over all patches and frames. No object is fitted: the engine has the parameters from which the benchmark
starts. Writes docs/results/survey.json.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.missing_physics.makers import WORLDS
from benchmarks.missing_physics.points import EPISODES, START
from plop.artifacts.atomic_file import write_json
from plop.comparison.discretisations import spacing_for
from plop.diagnosis.diagnose import SURVEY_PARTICLES, survey_of
from plop.diagnosis.responses.hypotheses import Hypothesis, candidates_of, hypotheses_of
from plop.diagnosis.responses.response_table import ResponseTable
from plop.diagnosis.responses.job import Job
from plop.diagnosis.responses.runs import Runs
from plop.identification.identify import PARTICLES
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import library
from plop.pipeline.execute import versions

SEED = 7990


def main() -> None:
    """Compare and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("artifacts/.survey"), help="Keeps finished runs.")
    parser.add_argument("--worlds", default="mujoco,own", help=f"some of {', '.join(WORLDS)}")
    parser.add_argument("--jobs", type=int, default=-1, help="Processes.")
    parser.add_argument("--out", type=Path, default=Path("docs/results/survey.json"))
    options = parser.parse_args()
    facts: dict[str, Any] = {
        "command": "python -m studies.survey",
        "versions": versions(),
        "seeds": [SEED],
        "particles": [SURVEY_PARTICLES, PARTICLES],
        "episodes": EPISODES,
        "worlds": {},
    }
    for world in options.worlds.split(","):
        facts["worlds"][world] = found = compared(world, Runs(options.work, jobs=options.jobs))
        write_json(options.out, facts, sort_keys=False)
        for law, row in found.items():
            sys.stdout.write(f"{world} {law}: {row}\n")
            sys.stdout.flush()


def compared(world: str, runs: Runs) -> dict[str, dict[str, Any]]:
    """Compare all laws in one world.

    Returns:
        Law -> "cosine" of the two responses and "size" of the coarse one along the other, of which it is a multiple:
        one for each amplitude and shape; "moves_mm": RMS displacement by the law.
    """
    maker = WORLDS[world](SEED)
    episodes = [maker.episode(k, {}) for k in range(EPISODES)]
    base = EngineBase(START, spacing_for(episodes, PARTICLES), True)
    survey = survey_of(base, episodes)
    assert survey is not None
    fine, coarse = (table_of(engine, episodes, runs) for engine in (base, survey))
    found: dict[str, dict[str, Any]] = {}
    for h in hypotheses_of(candidates_of(library())):
        if fine.trouble(h) or coarse.trouble(h) or len(h.runs) > 1:
            continue
        a, b = (np.concatenate([x.ravel() for x in table.response(h)]) for table in (fine, coarse))
        if a.any() and b.any():
            row = found.setdefault(h.effect, {"cosine": [], "size": [], "moves_mm": []})
            row["cosine"].append(round(float(a @ b / np.sqrt((a @ a) * (b @ b))), 3))
            row["size"].append(round(float(a @ b / (a @ a)), 3))
            row["moves_mm"].append(round(1000 * float(np.sqrt(3 * (a**2).mean())), 3))
    return found


def table_of(engine: EngineBase, episodes: list[Any], runs: Runs) -> ResponseTable:
    """Run all laws."""
    table = ResponseTable(engine, episodes, runs([Job(episode, engine) for episode in episodes]), runs)
    hypotheses: list[Hypothesis] = hypotheses_of(candidates_of(library()))
    table.respond(settings for h in hypotheses for settings, _ in h.runs)
    return table


if __name__ == "__main__":
    main()
