"""Resampling on and off, and the three kernels: `python -m benchmarks.ablations WORKSPACE OUT [ENVIRONMENT ...]`.

Takes an environment's last training of a workspace (`make reproduce` makes one), trains each variant on the same
fits and tracks with the same settings but the one that it changes, rolls out and scores the test episodes, and writes
the table into docs/results.md. What is in the folder OUT already is not made again.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from plop.artifacts.store import Artifact, Store
from plop.dynamics.interface import at_rest
from plop.dynamics.model_io import load_model
from plop.gaussians.splat_ply import read_splat
from plop.metrics.table import replace_between_markers
from plop.recordings.set import RecordingSet
from stages.contract import Input, Output
from stages.eval.stage import STAGE as EVAL
from stages.eval.stage import EvalConfig
from stages.rollout.predict import predict, tool_steps
from stages.rollout.stage import STAGE as ROLLOUT
from stages.rollout.stage import RolloutConfig
from stages.train.stage import STAGE as TRAIN
from stages.train.stage import TrainConfig

PAGE = Path(__file__).resolve().parent.parent / "docs" / "results.md"
VARIANTS: dict[str, dict[str, Any]] = {
    "quadratic (27 nodes)": {},
    "paper (8 nodes)": {"kernel": "paper"},
    "cubic (64 nodes)": {"kernel": "cubic"},
    "quadratic, no resampling": {"resample": False},
}
COLUMNS = {"cd_mm": "CD [mm]", "emd_mm": "EMD [mm]", "truth_rms_mm": "nodes [mm]"}
WARM_UP = 3
"""Steps that are not timed."""
TIMED_EPISODES = 1


def latest(store: Store, stage: str, environment: str) -> Artifact:
    """Give the last artifact of a stage for an environment."""
    return [a for a in store.artifacts(stage) if a.manifest.environment == environment][-1]


def inputs_of(store: Store, artifact: Artifact) -> dict[str, Input]:
    """Find the artifacts that one was made from."""
    found = {}
    for name, entry in artifact.manifest.inputs.items():
        source = store.get(entry["stage"], entry["fingerprint"])
        if source is None:
            raise SystemExit(f"{entry['stage']}@{entry['fingerprint'][:8]} is not in the workspace any more")
        found[name] = Input(source.path, source.manifest)
    return found


def run_variant(trained: Artifact, inputs: Mapping[str, Input], change: Mapping[str, Any], folder: Path) -> Path:
    """Train, roll out and score one variant; gives scores.json."""
    scores = folder / "eval" / "scores.json"
    if scores.is_file():
        return scores
    for name in ("train", "rollout", "eval"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    out = Output(folder / "train")
    if not (out.path / "tracks").is_dir():
        shutil.copytree(trained.path / "tracks", out.path / "tracks")
    for track in (out.path / "tracks").glob("*.h5"):
        out.mark_done(f"track-{track.stem}")
    TRAIN.run(inputs, replace(TrainConfig(**trained.manifest.config), **change), out)
    with_model = {**inputs, "model": Input(folder / "train")}
    ROLLOUT.run(with_model, RolloutConfig(), Output(folder / "rollout"))
    EVAL.run({**inputs, "rollouts": Input(folder / "rollout")}, EvalConfig(), Output(folder / "eval"))
    return scores


def step_ms(inputs: Mapping[str, Input], model_folder: Path) -> float:
    """Measure the median processor time of a predicted frame on one thread [ms]."""
    torch.set_num_threads(1)
    model = load_model(model_folder, torch.device("cpu"))
    recordings = RecordingSet.load(inputs["recordings"].path)
    spent: list[float] = []
    for name in recordings.test[:TIMED_EPISODES]:
        start = at_rest(read_splat(inputs["init"].path / name / "object.ply"))
        with recordings.open(name) as recording:
            states = predict(model, start, tool_steps(recording), name, 0)
            before = time.process_time()
            for frame, _ in enumerate(states):
                now = time.process_time()
                spent += [now - before] if frame > WARM_UP else []
                before = now
    return 1000 * float(np.median(spent))


def row(environment: str, label: str, scores: Path, milliseconds: float) -> str:
    """Give one line of the table."""
    parts = json.loads(scores.read_text())["methods"]["plop"]
    cells = [f"{parts[part][metric]['mean']:.2f}" for part in ("episode", "end") for metric in COLUMNS]
    return "| " + " | ".join([environment, label, *cells, f"{milliseconds:.1f}"]) + " |"


def table(rows: Iterable[str]) -> str:
    """Put the heading over the lines."""
    heads = [f"{title}, {part}" for part in ("whole", "end") for title in COLUMNS.values()]
    first = "| " + " | ".join(["environment", "variant", *heads, "ms a frame"]) + " |"
    return "\n".join([first, "|---|---|" + "---|" * (len(heads) + 1), *rows])


def main(workspace: Path, folder: Path, environments: list[str]) -> None:
    """Run all variants and write the table."""
    store = Store(workspace)
    known = sorted({a.manifest.environment for a in store.artifacts("train")})
    rows = []
    for environment in environments or known[:1]:
        trained = latest(store, "train", environment)
        inputs = inputs_of(store, trained)
        for label, change in VARIANTS.items():
            here = folder / environment / "-".join([f"{k}={v}" for k, v in change.items()] or ["as-it-is"])
            scores = run_variant(trained, inputs, change, here)
            rows.append(row(environment, label, scores, step_ms(inputs, here / "train")))
            sys.stdout.write(rows[-1] + "\n")
            sys.stdout.flush()
            PAGE.write_text(replace_between_markers(PAGE.read_text(), "ablations", table(rows)))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
