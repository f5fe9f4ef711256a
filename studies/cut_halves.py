"""What cohesion and cut faces bring: `python -m studies.cut_halves WORKSPACE [ENVIRONMENT ...]`.

Rolls out the trained models of a workspace (`make reproduce` makes one) with both, without one and without either: the
same weights each time. The test episodes are scored as `studies.ablations` scores them; the table goes into
docs/results.md, and what it shows into docs/results/cut_halves.json.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from benchmarks.workspace import latest
from plop.artifacts.store import Store
from plop.dynamics.model import PlopConfig
from plop.dynamics.model_io import load_model
from plop.pipeline.execute import versions
from studies.ablations import COLUMNS, Row, inputs_of, line, score, table

RESULT = Path("docs/results/cut_halves.json")


def variants(config: PlopConfig) -> Iterator[tuple[str, PlopConfig]]:
    """Give the forms in which a model is rolled out."""
    yield "both", config
    yield "no cohesion", replace(config, stray_m=None)
    yield "no cut faces", replace(config, cut_faces=False)
    yield "neither", replace(config, stray_m=None, cut_faces=False)


def scored(store: Store, environment: str) -> dict[str, Row]:
    """Roll out an environment's last model in every form; variant -> scores, "stray_mm" beside them."""
    trained = latest(store, "train", environment)
    inputs = inputs_of(store, trained)
    model = load_model(trained.path, torch.device("cpu"))
    found: dict[str, Row] = {}
    for label, config in variants(model.config):
        model.config = config
        found[label] = {**score(model, inputs), "stray_mm": None if config.stray_m is None else 1000 * config.stray_m}
    return found


def mean(rows: list[Row]) -> Row:
    """Average over environments."""
    parts = {
        part: {key: float(np.mean([row[part][key] for row in rows])) for key in COLUMNS} for part in ("episode", "end")
    }
    return {**parts, "ms": float(np.mean([row["ms"] for row in rows]))}


def main(workspace: Path, environments: list[str]) -> None:
    """Score all forms and write the table."""
    torch.set_num_threads(1)
    store = Store(workspace)
    names = environments or sorted({str(a.manifest.environment) for a in store.artifacts("train")})
    found: dict[str, dict[str, Row]] = {}
    for name in names:
        found[name] = scored(store, name)
        sys.stdout.write("".join(line(name, label, row) + "\n" for label, row in found[name].items()))
        sys.stdout.flush()
    lines = [line(name, label, row) for name, rows in found.items() for label, row in rows.items()]
    lines += [
        line("**mean**", label, mean([rows[label] for rows in found.values()])) for label in next(iter(found.values()))
    ]
    facts = {"command": "python -m studies.cut_halves WORKSPACE", "versions": versions(), "environments": found}
    RESULT.write_text(json.dumps(facts, indent=1) + "\n")
    sys.stdout.write(table(lines) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
