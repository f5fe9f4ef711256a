"""A step of the model under ways of waiting, quiet and beside a busy core: `python -m studies.waiting_policies`.

Each way is measured in processes of its own, in turn, since OpenMP reads its environment once.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import median

from benchmarks.speed.dynamics import i2n_step
from benchmarks.speed.measure import median_ms
from benchmarks.speed.waiting import busy_core
from plop.artifacts.atomic_file import write_json
from plop.compute.waiting import POLICY, SPIN

RESULT = Path(__file__).resolve().parent.parent / "docs" / "results" / "waiting.json"
WAYS: dict[str, dict[str, str]] = {
    "the library's own": {"GOMP_SPINCOUNT": "300000"},
    "spin briefly (plop's)": SPIN,
    "sleep at once": {"OMP_WAIT_POLICY": "PASSIVE"},
    "one thread": {**SPIN, "OMP_NUM_THREADS": "1"},
}
SIZES = (300, 3000, 10_000)


def measure() -> dict[str, float]:
    """Time a step of each size in this process, quiet and beside a busy core [ms]."""
    found = {}
    for size in SIZES:
        step = i2n_step(size)
        found[f"quiet_{size}_ms"] = median_ms(step, repeats=21, warm_up=5)
        with busy_core():
            found[f"busy_{size}_ms"] = median_ms(step, repeats=21, warm_up=3)
    return found


def main() -> None:
    """Measure every way in turn, several rounds, and write the medians with their least and greatest."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--one", action="store_true", help="measure this process and print JSON")
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    if options.one:
        sys.stdout.write(json.dumps(measure()))
        return
    clean = {name: value for name, value in os.environ.items() if name not in (*POLICY, "OMP_NUM_THREADS")}
    rows: dict[str, list[dict[str, float]]] = {way: [] for way in WAYS}
    load = os.getloadavg()[0]
    for _ in range(options.rounds):
        for way, variables in WAYS.items():
            done = subprocess.run(
                [sys.executable, "-m", "benchmarks.waiting_policies", "--one"],
                check=True,
                capture_output=True,
                text=True,
                env=clean | variables,
            )
            rows[way].append(json.loads(done.stdout))
            sys.stdout.write(f"{way:24s} " + "  ".join(f"{k} {v:.1f}" for k, v in rows[way][-1].items()) + "\n")
    write_json(
        options.out,
        {
            "command": "python -m studies.waiting_policies",
            "rounds": options.rounds,
            "load_1min_before": load,
            "cores": len(os.sched_getaffinity(0)),
            "ways": {
                way: {key: _spread([row[key] for row in found]) for key in found[0]} for way, found in rows.items()
            },
        },
        sort_keys=False,
    )


def _spread(values: list[float]) -> dict[str, float]:
    return {"median": round(median(values), 2), "least": round(min(values), 2), "greatest": round(max(values), 2)}


if __name__ == "__main__":
    main()
