"""Missing physics through bad cameras: `python -m benchmarks.physics_rough --minutes 90` (it goes on).

The runs of `physics_cameras` with 2 mm of noise in depth instead of 0.5 mm, and an arm two centimetres wide that holds
the tool and hides part of every view, in the recordings of the base as well. Laws are scaled to move the object as far
as there, 2 mm, which is once the noise here. Writes docs/results/physics_rough.json and a table of
docs/results-physics.md; `--summary` only rewrites the table.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from benchmarks.newest import newest_rows, written_rows
from benchmarks.physics_cameras import Loop, Run, go_on, planned
from benchmarks.physics_tables import runs_table
from plop.metrics.table import replace_between_markers
from plop.pipeline.execute import versions

RECORDED = ("--cameras.depth-noise-m", "0.002", "--arm-m", "0.02")
SNR = 1.0
"""Displacement by the hidden law over the noise of depth."""
CHOSEN = ("snr4-swelling", "null-0", "snr4-table_friction", "snr4-plasticity", "snr4-tilt", "null-1")


def rough_runs() -> list[Run]:
    """List the runs: those of the benchmark through cameras, with seeds of their own."""
    runs = {run.name: run for run in planned()}
    return [
        Run(
            name.replace("snr4", "rough").replace("null", "rough-null"),
            runs[name].set,
            runs[name].seed + 1000,
            runs[name].hide,
            SNR if runs[name].hide else 0.0,
        )
        for name in CHOSEN
    ]


def main() -> None:
    """Run what is left and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=90, help="Stop starting runs after so many minutes.")
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-physics-rough"), help="Workspace.")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="Folder with results-physics.md and results/.")
    parser.add_argument("--summary", action="store_true", help="Run nothing.")
    options = parser.parse_args()
    rows, path = options.work / "rows", options.out / "results" / "physics_rough.json"
    rows.mkdir(parents=True, exist_ok=True)
    kept = written_rows(path)
    if not options.summary:
        go_on(Loop(options.work, RECORDED), rough_runs(), rows, kept, options.minutes)
    found = newest_rows([run.name for run in rough_runs()], rows, kept)
    facts = {
        "command": "python -m benchmarks.physics_rough",
        "versions": versions(),
        "recorded": " ".join(RECORDED),
        "seeds": sorted({row["seed"] for row in found}),
        "runs": found,
    }
    path.write_text(json.dumps(facts, indent=1) + "\n")
    page = options.out / "results-physics.md"
    page.write_text(replace_between_markers(page.read_text(), "rough-runs", runs_table(found)))


if __name__ == "__main__":
    main()
