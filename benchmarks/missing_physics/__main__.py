"""The missing-physics benchmark: what `diagnose` says of recordings in which something, or nothing, is hidden.

    python -m benchmarks.missing_physics run --minutes 60 --first-seed 5000 --worlds own,mujoco,drake,cameras
    python -m benchmarks.missing_physics score

Goes on where it stopped; run it with seeds that nobody has looked at, and once for each version of `diagnose`. MuJoCo
and Drake: `pip install -e '.[worlds]'`. `cameras` and `*-cameras` type the commands of a user and take a quarter of an
hour a set, the others follow points and take a few minutes. `disect-cameras` needs a clone of DiSECt, see `cuts.py`.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from benchmarks.missing_physics.cameras import Cameras
from benchmarks.missing_physics.makers import WORLDS
from benchmarks.missing_physics.plan import CAMERAS, FILMED, GROUPS, Set, plan
from benchmarks.missing_physics.points import EPISODES, Points
from benchmarks.missing_physics.rates import GOALS, rates_of, rivals_of
from plop.artifacts.atomic_file import write_json
from plop.finite import json_ready
from plop.identification.identify import PARTICLES
from plop.pipeline.execute import versions

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"


def run(points: Points, minutes: float, sets: Iterable[Set]) -> None:
    """Make the rows that are lacking; none is started after so many minutes."""
    work, deadline = points.work, time.monotonic() + 60 * minutes
    cameras = Cameras(work)
    for one in sets:
        path = work / "rows" / f"{one.name}.json"
        if time.monotonic() > deadline:
            break
        if not path.is_file():
            row = (points if one.world in WORLDS else cameras).row(one)
            write_json(path, json_ready(row), sort_keys=False)
            verdict = row["said"]["reference"]["verdict"]
            sys.stdout.write(f"{one.name}: {verdict['kind']} {verdict['named']} (SNR {row['snr']:.1f})\n")
            sys.stdout.flush()


def score(work: Path, out: Path, command: str) -> None:
    """Write the result file."""
    rows = [json.loads(path.read_text()) for path in sorted((work / "rows").glob("*.json"))]
    repeated = {"repeated motions": True, "unlike motions": False}
    facts = {
        "command": command,
        "versions": versions(),
        "judged_by": sorted({row["judged_by"] for row in rows}),
        "seeds": sorted({row["seed"] for row in rows}),
        "bases": len({(row["world"], row["seed"]) for row in rows}),
        "rates": rates_of(rows, "reference"),
        "by_scenario": {
            **{
                name: rates_of([r for r in rows if r["repeated"] == flag], "reference")
                for name, flag in repeated.items()
            },
            "no reference": rates_of(rows, "none"),
        },
        "by_world": {
            w: rates_of([r for r in rows if r["world"] == w], "reference") for w in (*WORLDS, CAMERAS, *FILMED)
        },
        "rivals": rivals_of(rows),
        "goals": {name: f"{sign} {value:g}" for name, (sign, value) in GOALS.items()},
        **{key: sorted({row[key] for row in rows if key in row}) for key in ("particles", "episodes")},
        "cpu_s": {"median": float(np.median([row["cpu_s"] for row in rows])) if rows else None, "n": len(rows)},
        "runs": rows,
    }
    write_json(out, json_ready(facts), sort_keys=False)


def main() -> None:
    """Do what is asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.missing_physics", description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["run", "score"])
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-physics"))
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--first-seed", type=int, default=5000)
    parser.add_argument("--bases", type=int, default=15, help="bases in each world")
    parser.add_argument(
        "--worlds", default="own,mujoco,drake", help=f"some of {', '.join([*WORLDS, CAMERAS, *FILMED])}"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes of one set on points")
    parser.add_argument("--particles", type=int, default=PARTICLES, help="of the engine, for a set on points")
    parser.add_argument("--episodes", type=int, default=EPISODES, help="of a set on points, and of its reference")
    parser.add_argument("--groups", default=",".join(GROUPS), help=f"some of {', '.join(GROUPS)}")
    parser.add_argument("--out", type=Path, default=RESULTS / "missing_physics_0.2.0.json")
    options = parser.parse_args()
    worlds, groups = options.worlds.split(","), options.groups.split(",")
    for name, given, known in (("--worlds", worlds, [*WORLDS, CAMERAS, *FILMED]), ("--groups", groups, GROUPS)):
        if unknown := {*given} - {*known}:
            parser.error(f"{name}: some of {', '.join(known)}; not {', '.join(sorted(unknown))}")
    if options.what == "run":
        points = Points(options.work, options.jobs, options.particles, options.episodes)
        sets = (one for one in plan(options.first_seed, options.bases, worlds) if one.group in groups)
        run(points, options.minutes, sets)
    else:
        score(options.work, options.out, "python -m benchmarks.missing_physics run, then score")


if __name__ == "__main__":
    main()
