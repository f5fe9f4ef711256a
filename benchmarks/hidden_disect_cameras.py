"""Collect what `diagnose` said of the hidden DiSECt sets through cameras, from the artifacts of a workspace.

`python -m benchmarks.hidden_disect_cameras --workspace W --diagnoses unseen,folds` reads the artifacts that are named
unseen1 to unseen4, folds1 to folds4, and writes docs/results/hidden_disect_cameras.json. The commands that make them
are in docs/results-physics.md.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from plop.artifacts.store import Store
from plop_cli.execute import versions

SETS = (1, 2, 3, 4)
RANKED = 4
"""Effects of each ranking that are kept, besides the base's own parameter."""
DIGITS = 4


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workspace", type=Path, required=True)
    parser.add_argument("--diagnoses", required=True, help="Beginnings of the artifacts' names, with commas between.")
    parser.add_argument("--out", type=Path, default=Path("docs/results/hidden_disect_cameras.json"))
    options = parser.parse_args()
    store = Store(options.workspace)
    sets = {name: {f"set_{k}": collected(store, f"{name}{k}") for k in SETS} for name in options.diagnoses.split(",")}
    facts = {"command": f"python -m benchmarks.hidden_disect_cameras --workspace W --diagnoses {options.diagnoses}",
             "versions": versions(), "seeds": [0], "sets": sets}  # fmt: skip
    options.out.write_text(json.dumps(facts, indent=1))


def collected(store: Store, name: str) -> dict[str, Any]:
    """Read one diagnosis and keep what a page of results shows."""
    artifact = store.find(name)
    facts = json.loads((artifact.path / "diagnosis.json").read_text())
    kept = ("error", "floor", "closed_share", "episodes", "reference_episodes", "seconds")
    ranking = [_finding(row) for row in (*facts["ranking"][:RANKED], facts["base"])]
    verdict = facts["verdict"]
    return {"verdict": verdict["kind"], "named": verdict["named"], "text": verdict["text"],
            "diagnose_version": artifact.manifest.stage_version,
            **{key: _short(facts[key]) for key in kept}, "ranking": ranking}  # fmt: skip


def _finding(row: dict[str, Any]) -> dict[str, Any]:
    kept = ("effect", "gain", "gain_error", "p", "contrast_p", "passes", "reasons")
    parameters = {name: {key: _short(p[key]) for key in ("value", "low", "high", "unit")}
                  for name, p in row["parameters"].items()}  # fmt: skip
    return {**{key: _short(row[key]) for key in kept}, "parameters": parameters}


def _short(value: Any) -> Any:
    return round(value, DIGITS) if isinstance(value, float) else value


if __name__ == "__main__":
    main()
