"""Rank laws in DiSECt's jelly prism, from the runs of collect.py. usage: rank.py EV.pkl

Every set with a reference of other motions and with one of the same motions (the unchanged twin recordings), with the
discrepancy model as it is, and with half and twice of each of its numbers.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from plop.comparison.discretisations import discretised
from plop.diagnosis.decision.conclusion import conclude
from plop.diagnosis.evidence.discrepancy import SPREAD, Spread
from plop.diagnosis.responses.hypotheses import candidates_of
from plop.diagnosis.responses.job import Answer, Job
from plop.diagnosis.responses.hypotheses import base_hypotheses
from plop.diagnosis.scores.search import Search
from plop.diagnosis.responses.table import Measured, Table
from plop.physics.effects.library import library
from plop.tracking.episode import Episode

SETS = ("null", "set_1", "set_3", "set_4")
CHANGED = {"set_1": "swelling", "set_3": "table_friction", "set_4": "stiffness", "null": "-"}


def remembered(stored: dict[str, Any]) -> Callable[[Sequence[Job]], list[Answer]]:
    """Answer jobs from what was run; what was not run is left out as if it were unstable."""
    names = ["plain", "plain0.86", "plain1.16"]
    spacings = [member.spacing_m for member in discretised(stored["base"])]

    def one(job: Job) -> Answer:
        if not job.settings:
            key: Any = names[spacings.index(job.base.spacing_m)]
        else:
            ((column, value),) = job.settings
            law = column.key.rsplit(".", 1)[0].removesuffix("()")
            found = [k for n, k in stored["answers"] if n == job.episode.name and not isinstance(k, str)]
            near = [k for k in found if k[0] == law and k[2] == column.key and np.isclose(k[3] * column.value, value)]
            key = near[0] if near else None
        points, trouble = stored["answers"].get((job.episode.name, key), (None, "not run"))
        return Answer(points, trouble)

    return lambda jobs: [one(job) for job in jobs]


def at(here: Episode, other: Episode) -> Episode:
    """Read a twin recording off at the material points of this one."""
    near = cKDTree(other.points[0]).query(here.points[0], k=6)[1]
    moved = np.median((other.points - other.points[:1])[:, near], axis=2)
    return replace(here, points=moved + here.points[:1])


def search(stored: dict[str, Any], which: str, twins: bool, spread: Spread) -> Search:
    """Set up the search for one set."""
    home, tests = stored["sets"]["null"], {e.name: e for e in stored["sets"][which]}
    here = home if which == "null" else [at(e, tests[e.name]) for e in home]
    candidates, run = candidates_of(library()), remembered(stored)
    tables = [Table(Measured(list(e)), stored["base"], run) for e in (here, home if twins else stored["ref"])]
    return Search(tables, candidates, base_hypotheses(candidates), spread)


def main() -> None:
    """Print a line for each set, reference and spread."""
    with open(sys.argv[1], "rb") as file:
        stored = pickle.load(file)  # noqa: S301 -- made by collect.py on this machine
    names = ("share", "reach", "rough")
    spreads = [("as it is", SPREAD)]
    spreads += [(f"{n} x {f:g}", replace(SPREAD, **{n: f * getattr(SPREAD, n)})) for n in names for f in (0.5, 2)]
    spreads += [(f"repeat {r:g}", replace(SPREAD, repeat=r)) for r in (0.9, 0.99)]
    for label, spread in spreads:
        for which in SETS:
            for twins in (False, True):
                if which == "null" and twins:
                    continue
                found = conclude(search(stored, which, twins, spread))
                facts, best = found.verdict.evidence, [f for f in found.findings if f.kind != "decoy"][:2]
                first, second = (f"{f.name} {f.score.strength:.0f} (p {f.score.p:.3f})" for f in best)
                reference = "same motions" if twins else "other motions"
                print(
                    f"{label} | {CHANGED[which]} | {reference} | {found.verdict.kind} {', '.join(found.verdict.named)} | "
                    f"{first} | {second} | {facts.change_p} | {facts.closed}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
