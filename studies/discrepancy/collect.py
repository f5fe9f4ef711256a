"""Engine runs of every law in DiSECt's jelly prism, from exact points with noise. usage: collect.py DATA EV.pkl

DATA is the folder with disect, disect_hidden and disect_hidden_2. 12 minutes of a quiet core; call it again to go on.
"""

from __future__ import annotations

import os
import pickle
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from plop.comparison.discretisations import spacing_for
from plop.diagnosis.responses.hypotheses import candidates_of
from plop.diagnosis.responses.job import Job, run_job
from plop.identification.identify import NAMES, PARTICLES, identify, starts_settled
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import library
from plop.physics.engine.material import ElasticLaw, Material
from plop.recordings.readers.disect.episode import list_disect, read_disect
from plop.tracking.episode import Episode, episode_from_sequence

NOISE_M = 3e-4
REFERENCE = [f"prism_jelly_part_00{k}" for k in range(5)]
DISCRETISATIONS = (0.86, 1.16)


def read(folder: Path, names: list[str] | None = None, seed: int = 0) -> list[Episode]:
    """Read episodes as an ideal tracker with noise would give them."""
    chosen = [raw for raw in list_disect(folder) if names is None or raw.name in names]
    return [
        episode_from_sequence(read_disect(raw.path), noise_m=NOISE_M, seed=seed + k, name=raw.name)
        for k, raw in enumerate(chosen)
    ]


def jobs_of(episodes: list[Episode], base: EngineBase, multiples: tuple[float, ...]) -> dict[Any, Job]:
    """List the runs: without a law in three discretisations, and every law at multiples of its typical amplitude."""
    found: dict[Any, Job] = {}
    for e in episodes:
        found[(e.name, "plain")] = Job(e, base)
        for share in DISCRETISATIONS:
            found[(e.name, f"plain{share}")] = Job(e, replace(base, spacing_m=share * base.spacing_m))
        for c in candidates_of(library()):
            for column in c.columns:
                for multiple in multiples:
                    value = column.value * multiple
                    if column.low <= value <= column.high:
                        key = (e.name, (c.key, c.kind, column.key, multiple))
                        found[key] = Job(e, base, ((column, value),))
    return found


def main() -> None:
    """Fit the base, then run what has not been run."""
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    reference = read(data / "disect", REFERENCE)
    sets = {"null": read(data / "disect_hidden_2" / "prism_null", seed=100)}
    sets |= {f"set_{k}": read(data / "disect_hidden" / f"set_{k}", seed=100 + 100 * k) for k in (1, 2, 3, 4)}
    if out.exists():
        stored = pickle.loads(out.read_bytes())  # noqa: S301 -- made here
    else:
        base = EngineBase(replace(Material(), law=ElasticLaw.NEO_HOOKEAN), spacing_for(reference, PARTICLES))
        base = replace(base, settled=starts_settled(reference[:3], base))
        base, _ = identify(reference, base, NAMES, iterations=5, jobs=1)
        stored = {"base": base, "ref": reference, "sets": sets, "answers": {}}
    answers, types = stored["answers"], library()
    wanted = jobs_of(sets["null"], stored["base"], (1.0, 0.3, 3.0, -1.0))
    wanted |= jobs_of(reference, stored["base"], (1.0, 0.3, -1.0))
    for number, (key, job) in enumerate((k, j) for k, j in wanted.items() if k not in answers):
        answer = run_job(job, types)
        answers[key] = (answer.points, answer.trouble)
        if number % 100 == 0:
            scratch = out.with_suffix(".tmp")
            scratch.write_bytes(pickle.dumps(stored))
            os.replace(scratch, out)
    out.write_bytes(pickle.dumps(stored))


main()
