"""Measure speed and write docs/results/bench.json: `python -m benchmarks.speed [WORD ...]`."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.facts import machine
from benchmarks.speed.goals import goals_table
from plop.artifacts.atomic_file import write_json
from plop.compute.malloc import keep_freed_memory

RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "bench.json"
MODULES = ("dynamics", "engine", "fit_init", "ingest", "raster", "train", "waiting")
"""Modules of this package that offer `cases()`."""
Cases = dict[str, Callable[[], float]]


def collect(words: list[str]) -> Cases:
    """Collect the cases whose module or name contains one of the words; all when no word is given."""
    found: Cases = {}
    for module in MODULES:
        for name, measure in importlib.import_module(f"benchmarks.speed.{module}").cases().items():
            if not words or any(word in f"{module} {name}" for word in words):
                found[name] = measure
    return found


def measured(cases: Cases) -> tuple[dict[str, float], list[str]]:
    """Measure, printing one line per case; return the figures and the names of the cases that failed."""
    figures, failed = {}, []
    for name, measure in cases.items():
        try:
            figures[name] = round(float(measure()), 4)
        except Exception as error:  # the other cases are still measured
            sys.stderr.write(f"{name}: failed, {type(error).__name__}: {error}\n")
            failed.append(name)
            continue
        sys.stdout.write(f"{name:56s} {figures[name]:12.4g}\n")
        sys.stdout.flush()
    return figures, failed


def merged(
    kept: Mapping[str, Any], figures: Mapping[str, float], *, command: str, machine: Mapping[str, object], load: float
) -> dict[str, Any]:
    """Merge new figures with earlier ones, and record how each was measured.

    Args:
        kept: Content of the result file; empty when every case was measured.
        figures: Case -> the new figure.
        command: The command that measured it.
        machine: The machine; a case measured on another machine than the file's records the differences.
        load: Load of the machine before the run (mean number of processes over a minute).

    Returns:
        "command" (of the whole file), "machine", "cases", and "measured": case -> its command and load.
    """
    of_file = dict(kept.get("machine", machine))
    own = {"command": command, "load_1min_before": load}
    own |= {name: fact for name, fact in machine.items() if of_file.get(name) != fact}
    return {
        "command": kept.get("command", command),
        "machine": of_file,
        "cases": {**kept.get("cases", {}), **figures},
        "measured": {**kept.get("measured", {}), **dict.fromkeys(figures, own)},
    }


def main() -> int:
    """Measure, and merge the figures into the result file; 1 when a case failed or no case has such a name."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed", description=__doc__)
    parser.add_argument("words", nargs="*", help="run only cases whose module or name holds one of these")
    parser.add_argument("--out", type=Path, default=RESULT)
    parser.add_argument("--table", action="store_true", help="measure nothing; print the file beside the goals")
    options = parser.parse_args()
    if options.table:
        sys.stdout.write(goals_table(json.loads(options.out.read_text(encoding="utf-8"))["cases"]) + "\n")
        return 0
    cases = collect(options.words)
    if not cases:
        parser.error(f"no case is called {' or '.join(options.words)}; there are {', '.join(collect([]))}")
    keep_freed_memory()  # as every command does
    command = f"python -m benchmarks.speed {' '.join(options.words)}" if options.words else "make bench"
    facts, load = machine(), round(os.getloadavg()[0], 2)
    figures, failed = measured(cases)
    kept = json.loads(options.out.read_text(encoding="utf-8")) if options.words and options.out.is_file() else {}
    write_json(options.out, merged(kept, figures, command=command, machine=facts, load=load))
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
