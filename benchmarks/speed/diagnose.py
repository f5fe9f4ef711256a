"""Time `diagnose` and `report` with eight episodes and eight of the reference: `python -m benchmarks.speed.diagnose`.

Runs the commands through cameras (six of 128 px) in the workspace of --work: recordings with adhesion hidden, an
engine of `identify`'s own 1,300 particles, then `diagnose` without the cache of engine runs: with twelve laws, with the
whole library, and with adhesion left out of the library, so that pairs of laws are tried, which takes longest. Writes
docs/results/diagnose_time.json. Half an hour on two cores; existing artifacts are reused, except the diagnoses.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from benchmarks.facts import machine
from benchmarks.missing_physics.cameras import FINER, workspace
from benchmarks.workspace import Typed
from plop.artifacts.atomic_file import write_json
from plop.physics.effects.library import library
from plop.pipeline.execute import versions

EPISODES = ("--episodes", "8")
SEED, REFERENCE_SEED, SNR = 4000, 100, 4
HIDDEN = "adhesion"
YOUNGER = ("cohesion", "graded", "layered", "crust")
"""Laws added after the goals and the stored times, which are for twelve laws."""
GOALS = {"screen_min": 6, "whole_min": 15, "report_s": 30, "report_mb": 25}
"""Largest times of `diagnose` with twelve laws, and time and size of the report."""
RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "diagnose_time.json"


def main() -> None:
    """Measure and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-diagnose"), help="Workspace.")
    options = parser.parse_args()
    loop = workspace(options.work)
    loop.plop("simulate", "block.toml", "--seed", str(REFERENCE_SEED), *EPISODES, "--name", "plain")
    loop.plop("identify", "--recordings", "plain", "--split", "all", "--name", "base", *FINER)
    hide = ("--hide", HIDDEN, "--snr", str(SNR), "--name", "mystery")
    loop.plop("simulate", "block.toml", "--seed", str(SEED), *EPISODES, *hide)
    loop.plop("compare", "--model", "base", "--recordings", "mystery")  # makes the tracks
    on, rows = machine(), []
    for what, laws in libraries().items():
        rows.append({"what": what, "laws": len(laws), **diagnosed(loop, laws)})
        sys.stdout.write(f"{rows[-1]}\n")
        sys.stdout.flush()
    facts = {
        "command": "python -m benchmarks.speed.diagnose",
        "versions": versions(),
        "machine": on,
        "seeds": [REFERENCE_SEED, SEED],
        "diagnoses": rows,
        "goals": GOALS,
        "report": reported(loop),
    }
    write_json(RESULT, facts, sort_keys=False)


def libraries() -> dict[str, list[str]]:
    """Return the laws of each diagnosis: the twelve that act on the object, all, and all but the hidden one."""
    laws = library()
    twelve = [name for name, law in laws.items() if law.kind == "physics" and name not in YOUNGER]
    return {
        "twelve laws": twelve,
        "the whole library": list(laws),
        "the hidden law left out": [name for name in laws if name != HIDDEN],
    }


def diagnosed(loop: Typed, laws: list[str]) -> dict[str, Any]:
    """Diagnose with an empty cache of engine runs."""
    forget(loop)
    words = [word for law in laws for word in ("--effects", law)]
    loop.plop("diagnose", "--model", "base", "--recordings", "mystery", "--name", "timed", "--force", *words)
    found = json.loads((loop.store.find("timed").path / "diagnosis.json").read_text())
    return {
        "verdict": found["verdict"]["kind"],
        "named": found["verdict"]["named"],
        "screen_s": found["seconds_screen"],
        "whole_s": found["seconds"],
        "engine_runs": found["engine_runs"],
        "episodes": len(found["episodes"]),
        "reference_episodes": len(found["reference_episodes"]),
    }


def forget(loop: Typed) -> None:
    """Remove the cached engine runs of earlier diagnoses."""
    shutil.rmtree(loop.store.root / ".cache" / "diagnose", ignore_errors=True)


def reported(loop: Typed) -> dict[str, Any]:
    """Make the report of base and recordings; return its time and its size."""
    loop.plop("eval", "--model", "base", "--recordings", "mystery", "--name", "scores")
    loop.plop("report", "--models", "base", "--recordings", "mystery", "--name", "page", "--force")
    page = loop.store.find("page")
    return {"seconds": page.manifest.provenance["seconds"], "megabytes": sum(page.manifest.sizes.values()) / 1e6}


if __name__ == "__main__":
    main()
