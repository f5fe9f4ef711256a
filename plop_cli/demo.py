"""The main job, offline: simulate a small set, run every stage on it, show scores, video and times."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

from plop.artifacts.store import Store
from plop_cli.chain import AFTER_INGEST, check_layers, layers_of, read_profile, run_step, show_times
from plop_cli.console import Console
from plop_cli.execute import Outcome


def run_demo(store: Store, console: Console, *, seed: int, assignments: list[str]) -> None:
    """Run the demo; what an earlier, stopped run finished is kept."""
    layers = layers_of(store, read_profile("demo"), assignments)
    commands = ("ingest mesh", *AFTER_INGEST)
    check_layers(layers, commands)
    raw = _simulate(store.workspace, console, seed)
    made: dict[str, Outcome] = {}
    done: dict[str, Outcome] = {}
    for command in commands:
        outcome = run_step(command, store=store, console=console, layers=layers, made=made, raw=raw)
        made[outcome.artifact.manifest.stage] = outcome
        done[command] = outcome
    scores = made["eval"].artifact
    videos = sorted(made["rollout"].artifact.path.glob("*/video.mp4"))
    console.table(scores.manifest.summary.get("table", []), title="scores")
    show_times(console, done)
    for video in videos:
        console.say(f"video (measured | predicted | difference): {_shown(video)}")
    console.say(f"scores: {_shown(scores.path / 'scores.json')}")
    console.result(_facts(scores.manifest.summary, videos, {name: outcome.seconds for name, outcome in done.items()}))


def _facts(summary: dict[str, Any], videos: list[Path], times: dict[str, float]) -> dict[str, Any]:
    return {"scores": summary, "videos": [str(video) for video in videos], "seconds": times}


def _simulate(workspace: Path, console: Console, seed: int) -> Path:
    """Write the raw recordings once; a folder under the final name is whole."""
    from plop.physics.demo import make_demo_recordings

    folder = workspace / f"raw-{seed}" / "demo"
    if folder.is_dir():
        return folder
    draft = workspace / f"raw-{seed}" / ".partial"
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir(parents=True)
    with console.progress("simulate") as progress:
        make_demo_recordings(draft, seed=seed, progress=progress)
    os.replace(draft, folder)
    console.say(f"simulated recordings in {_shown(folder)}")
    return folder


def _shown(path: Path) -> str:
    """Name a path relative to the current folder where that is shorter."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)
