"""Run every benchmark, write docs/results/bench.json and the table of docs/speed.md: `python -m benchmarks [WORD]`."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.goals import goals_table
from plop.artifacts.atomic_file import write_text
from plop.compute.malloc import keep_freed_memory
from plop.metrics.table import replace_between_markers

HERE = Path(__file__).resolve().parent
RESULT = HERE.parent / "docs" / "results" / "bench.json"
PAGE = HERE.parent / "docs" / "speed.md"


def collect(words: list[str]) -> dict[str, Callable[[], float]]:
    """Gather the cases of all bench_*.py whose file or case name holds one of the words (all without words)."""
    found: dict[str, Callable[[], float]] = {}
    for path in sorted(HERE.glob("bench_*.py")):
        try:
            cases = importlib.import_module(f"benchmarks.{path.stem}").cases()
        except ImportError as error:
            sys.stderr.write(f"{path.stem}: left out, {error}\n")
            continue
        for name, measure in cases.items():
            if not words or any(word in f"{path.stem} {name}" for word in words):
                found[name] = measure
    return found


def machine() -> dict[str, object]:
    """Describe what the figures were measured on."""
    import torch

    facts: dict[str, object] = {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "torch_threads": torch.get_num_threads(),
        "python": platform.python_version(),
        "torch": torch.__version__,
    }
    if torch.cuda.is_available():
        facts["gpu"] = torch.cuda.get_device_name()
    return facts


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def main() -> int:
    """Measure, print one line a case, and merge the figures into the result file."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("words", nargs="*", help="run only cases whose file or name holds one of these")
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    keep_freed_memory()  # as every command does
    command = f"python -m benchmarks {' '.join(options.words)}" if options.words else "make bench"
    facts, load = machine(), round(os.getloadavg()[0], 2)
    figures: dict[str, float] = {}
    failed = False
    for name, measure in collect(options.words).items():
        try:
            figures[name] = round(float(measure()), 4)
        except Exception as error:
            sys.stderr.write(f"{name}: failed, {type(error).__name__}: {error}\n")
            failed = True
            continue
        sys.stdout.write(f"{name:56s} {figures[name]:12.4g}\n")
        sys.stdout.flush()
    kept = json.loads(options.out.read_text(encoding="utf-8")) if options.words and options.out.is_file() else {}
    result = merged(kept, figures, command=command, machine=facts, load=load)
    write_text(options.out, json.dumps(result, indent=1, sort_keys=True) + "\n")
    if options.out == RESULT:
        PAGE.write_text(replace_between_markers(PAGE.read_text(), "bench", goals_table(result["cases"])))
    return 1 if failed else 0


def merged(
    kept: Mapping[str, Any], figures: Mapping[str, float], *, command: str, machine: Mapping[str, object], load: float
) -> dict[str, Any]:
    """Put new figures beside those that were measured before, and say of each how it was measured.

    Args:
        kept: What the result file holds; empty when every case was measured.
        figures: Case -> what has just been measured.
        command: What measured it.
        machine: On what; a case whose machine is another than the file's says where it differs.
        load: What ran on the machine before (mean number of processes over a minute).

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


if __name__ == "__main__":
    raise SystemExit(main())
