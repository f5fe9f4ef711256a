"""What images and resampling are worth: `python -m benchmarks.ablation [--environments NAME ...] [--seeds N ...]`.

Simulates cuts of the shipped scenes, fits their first frames, and trains a model on tracks only, on images only, and on
both, each with and without merging and splitting; scores the rollouts of the test episodes. Finished runs are kept in
the workspace, and finished rows in the result file: the same command goes on where it stopped. `--epochs` says how much
of the paper's 50,000 is trained.
"""

from __future__ import annotations

import argparse
import importlib.resources
import itertools
import json
import sys
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.facts import machine
from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Model, ScoreFiles
from plop.artifacts.store import Artifact, Store
from plop.metrics.scores import Scores
from plop.pipeline.execute import versions
from plop.pipeline.run import run
from plop.statistics.bootstrap import bootstrap_interval

RESULT = Path(__file__).resolve().parents[1] / "docs" / "results" / "ablation.json"
TARGETS = ("tracks", "images", "both")
METRICS = {"cd_mm": "cd_mm", "emd_mm": "emd_mm", "ssim": "ssim", "psnr_db": "psnr_db", "j": "j_score"}
"""Name in a row -> name of the score."""
PAPER_EPOCHS = 50_000
SIMULATE = {"episodes": 6, "cameras": {"size": 64, "count": 4, "texture": "dough"}}
FIT = {"count": 1000, "steps": 600, "virtual_views": 0, "held_out": 0, "render": {"depth_unit_m": 0.02, "mask": 0.3}}
TRAIN: dict[str, Any] = {"batch": 1, "horizon": 1000, "learning_rate": 1e-3, "update": {"iterations": 8}}
RESAMPLING = {"split_share": 0.02, "merge_share": 0.01, "max_count": 3000}
"""Thresholds that one of fifty, and one of a hundred, fitted Gaussians exceeds."""
Row = dict[str, Any]


def training(targets: str, resampling: bool, steps: int, epochs: int, seed: int) -> dict[str, Any]:
    """Return the settings of `train` of one variant: the same model, targets and resampling apart."""
    tracked, pictured = targets != "images", targets != "tracks"
    return {
        **TRAIN,
        "seed": seed,
        "track_steps": steps if tracked else 0,
        "image_steps": 0,
        "epochs": epochs if pictured else 0,
        "cohesion": False,
        "weights": {"track": 1.0 if tracked else 0.0},
        "resampling": {"enabled": resampling, **RESAMPLING},
        # a curriculum up to four frames on tracks; on images whole episodes
        "horizon": TRAIN["horizon"] if pictured else 4,
    }


def scene_of_cuts(name: str, workspace: Path) -> Path:
    """Write the shipped scene of a name with cuts only."""
    text = (importlib.resources.files("plop.physics.scenes") / f"{name}.toml").read_text(encoding="utf-8")
    lines = ['motions = ["cut-push"]' if line.startswith("motions") else line for line in text.splitlines()]
    path = workspace / f"{name}.toml"
    workspace.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def prepared(store: Store, environment: str) -> tuple[Artifact, Artifact]:
    """Return the recordings of an environment, and the fits of their first frames."""
    scene = scene_of_cuts(environment, store.workspace)
    recordings = run("simulate", store, scene=scene, **SIMULATE)
    return recordings, run("fit-init", store, recordings=recordings, **FIT)


def scored(store: Store, recordings: Artifact, init: Artifact, settings: Mapping[str, Any], seed: int) -> Row:
    """Train one variant and score its rollouts; return the scores and counts of a row."""
    given = {"recordings": recordings, "init": init}
    model = run("train", store, **given, **settings)
    rollout = run("rollout", store, **given, model=model, seed=seed)
    artifact = run("eval", store, **given, rollouts=rollout, emd_every=8)
    scores = Scores.load(ScoreFiles(artifact.path).report)
    table = rollout.manifest.summary["table"]
    log = [json.loads(line) for line in Model(model.path).log.read_text().splitlines()]
    steps = [line for line in log if "image" in line]
    episodes = {
        name: {short: parts[scores.method]["episode"].get(metric) for short, metric in METRICS.items()}
        for name, parts in scores.episodes.items()
    }
    return {
        "splits": float(np.mean([row["splits"] for row in table])),
        "merges": float(np.mean([row["merges"] for row in table])),
        **{short: float(np.mean([one[short] for one in episodes.values()])) for short in METRICS},
        "episodes": episodes,
        "train_per_frame": {
            key: float(np.mean([s[key] for s in steps])) if steps else 0.0 for key in ("splits", "merges")
        },
        "persistence": {
            short: getattr(scores.methods["persistence"]["episode"][metric], "mean", None)
            for short, metric in METRICS.items()
        },
    }


def effects(rows: Iterable[Row]) -> list[Row]:
    """Return what resampling, and the image loss, changes: paired differences over environments, seeds and episodes."""
    known = {(r["environment"], r["seed"], r["targets"], r["resampling"]): r["episodes"] for r in rows}
    pairs = [("resampling", (targets, True), (targets, False)) for targets in TARGETS]
    pairs += [("images", (targets, on), ("tracks", on)) for targets in ("images", "both") for on in (False, True)]
    found = []
    for of, (targets, on), base in pairs:
        both = [
            (known[environment, seed, targets, on], known[environment, seed, *base])
            for environment, seed, *variant in known
            if variant == [targets, on] and (environment, seed, *base) in known
        ]
        row: Row = {"of": of, "targets": targets, "resampling": on, "than": f"{base[0]}, {'on' if base[1] else 'off'}"}
        for metric in METRICS:
            change = [a[name][metric] - b[name][metric] for a, b in both for name in a]
            interval = bootstrap_interval(change, seed=0)
            row[metric] = interval and {"mean": interval.mean, "low": interval.low, "high": interval.high}
            row["n"] = len(change)
        found += [row] if both else []
    return found


def main() -> int:
    """Make the rows that are lacking, and write the result after each."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ablation", description=__doc__)
    parser.add_argument("--environments", nargs="+", default=["block", "cylinder", "sphere"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--steps", type=int, default=400, help="optimisation steps on tracks")
    parser.add_argument("--epochs", type=int, default=100, help="epochs on images")
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no row after this time")
    parser.add_argument("--workspace", "-w", type=Path, default=Path("ablation"))
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    store, started = Store(options.workspace), time.monotonic()
    about = {"track_steps": options.steps, "epochs": options.epochs, "share_of_epochs": options.epochs / PAPER_EPOCHS}
    kept = json.loads(options.out.read_text()) if options.out.is_file() else {}
    rows: list[Row] = kept["rows"] if kept.get("schedule") == about else []
    chosen = f"--environments {' '.join(options.environments)} --seeds {' '.join(map(str, options.seeds))}"
    command = f"python -m benchmarks.ablation {chosen} --steps {options.steps} --epochs {options.epochs}"
    for environment, seed in itertools.product(options.environments, options.seeds):
        for targets, resampling in itertools.product(TARGETS, (False, True)):
            named = {"environment": environment, "seed": seed, "targets": targets, "resampling": resampling}
            if any(named.items() <= row.items() for row in rows) or time.monotonic() - started > 60 * options.minutes:
                continue
            settings = training(targets, resampling, options.steps, options.epochs, seed)
            rows.append({**named, **scored(store, *prepared(store, environment), settings, seed)})
            facts = {"command": command, "versions": versions(), "machine": machine(), "schedule": about}
            write_json(options.out, {**facts, "rows": rows, "effects": effects(rows)})
            shown = "  ".join(f"{metric} {rows[-1][metric]:.3f}" for metric in METRICS)
            sys.stdout.write(f"{environment} seed {seed} {targets:6s} resampling {resampling!s:5s}  {shown}\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
