"""Time `diagnose` and `report` with six episodes and six of the reference: `python -m benchmarks.speed.diagnose`.

Runs the commands through cameras (six of 128 px) in the workspace of --work: recordings with adhesion hidden, an
engine of `identify`'s own 1,300 particles, then `diagnose` of tracked episodes with the whole library: without any
engine run in the cache, and again with all of them. Writes docs/results/diagnose_time.json. A quarter of an hour on two
cores; existing artifacts are reused, except the diagnoses.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from benchmarks.facts import machine
from benchmarks.missing_physics.cameras import workspace
from benchmarks.workspace import Typed
from plop.artifacts.atomic_file import write_json
from plop.pipeline.execute import versions

SEED, REFERENCE_SEED, SNR = 4000, 100, 4
HIDDEN = "adhesion"
RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "diagnose_time.json"


def main() -> None:
    """Measure and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-diagnose"), help="Workspace.")
    options = parser.parse_args()
    loop = workspace(options.work)
    loop.plop("simulate", "block.toml", "--seed", str(REFERENCE_SEED), "--name", "plain")
    loop.plop("identify", "--recordings", "plain", "--split", "all", "--name", "base")
    hide = ("--hide", HIDDEN, "--snr", str(SNR), "--motions-seed", str(REFERENCE_SEED), "--name", "mystery")
    loop.plop("simulate", "block.toml", "--seed", str(SEED), *hide)
    loop.plop("compare", "--model", "base", "--recordings", "plain")  # makes the tracks
    loop.plop("compare", "--model", "base", "--recordings", "mystery")
    on, rows = machine(), []
    shutil.rmtree(loop.store.root / ".cache" / "diagnose", ignore_errors=True)
    for what, goal_min in (("no engine run cached", 5), ("all engine runs cached", 2)):
        rows.append({"what": what, "goal_min": goal_min, **diagnosed(loop)})
        sys.stdout.write(f"{rows[-1]}\n")
        sys.stdout.flush()
    facts = {
        "command": "python -m benchmarks.speed.diagnose",
        "versions": versions(),
        "machine": on,
        "seeds": [REFERENCE_SEED, SEED],
        "diagnoses": rows,
        "report": reported(loop),
    }
    write_json(RESULT, facts, sort_keys=False)


def diagnosed(loop: Typed) -> dict[str, Any]:
    """Diagnose, again where it has been done."""
    loop.plop("diagnose", "--model", "base", "--recordings", "mystery", "--name", "timed", "--force")
    artifact = loop.store.find("timed")
    found = json.loads((artifact.path / "diagnosis.json").read_text())
    return {
        "verdict": found["verdict"]["kind"],
        "named": found["verdict"]["named"],
        "laws": len(found["ranking"]),
        "seconds": artifact.manifest.provenance["seconds"],
        "engine_runs": artifact.manifest.summary["figures"]["engine_runs"],
        "episodes": len(found["episodes"]),
        "reference_episodes": len(found["reference_episodes"]),
    }


def reported(loop: Typed) -> dict[str, Any]:
    """Make the report of base and recordings; return its time and its size."""
    loop.plop("eval", "--model", "base", "--recordings", "mystery", "--name", "scores")
    loop.plop("report", "--models", "base", "--recordings", "mystery", "--name", "page", "--force")
    page = loop.store.find("page")
    return {"seconds": page.manifest.provenance["seconds"], "megabytes": sum(page.manifest.sizes.values()) / 1e6}


if __name__ == "__main__":
    main()
