"""The main job, offline: simulate a small set, run every stage on it, show scores, video and times."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from plop.artifacts.layouts import ScoreFiles
from plop.artifacts.store import Store
from plop.pipeline.chain import AFTER_INGEST, check_layers, layers_of, read_profile, run_step
from plop.pipeline.execute import Outcome
from plop_cli.console import Console
from plop_cli.listener import Chained
from plop_cli.outcome import show_times
from plop_cli.pictures import say_videos, shown


def run_demo(store: Store, console: Console, *, seed: int, assignments: list[str]) -> None:
    """Run the demo; what an earlier, stopped run finished is kept."""
    layers = layers_of(store, read_profile("demo"), assignments)
    commands = ("ingest mesh", *AFTER_INGEST)
    check_layers(layers, commands)
    raw = _simulate(store.workspace, console, seed)
    made: dict[str, Outcome] = {}
    done: dict[str, Outcome] = {}
    for command in commands:
        outcome = run_step(command, store=store, listener=Chained(console), layers=layers, made=made, raw=raw)
        made[outcome.artifact.manifest.stage] = outcome
        done[command] = outcome
    scores = made["eval"].artifact
    console.table(scores.manifest.summary.get("table", []), title="scores")
    show_times(console, done)
    pictures = say_videos(console, made["rollout"].artifact)
    for picture in ScoreFiles(scores.path).pictures:
        console.say(f"  first, middle and last frame: {shown(picture)}")
    console.say(f"scores: {shown(ScoreFiles(scores.path).report)}, over time: {shown(ScoreFiles(scores.path).over_time)}")
    seconds = {name: outcome.seconds for name, outcome in done.items()}
    console.result({"scores": scores.manifest.summary, **pictures, "seconds": seconds})


def _simulate(workspace: Path, console: Console, seed: int) -> Path:
    """Write the raw recordings once; a folder under the final name is whole."""
    from plop.physics.scenes.demo import make_demo_recordings

    folder = workspace / f"raw-{seed}" / "demo"
    if folder.is_dir():
        return folder
    draft = workspace / f"raw-{seed}" / ".partial"
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir(parents=True)
    with console.progress("simulate") as progress:
        make_demo_recordings(draft, seed=seed, progress=progress)
    os.replace(draft, folder)
    console.say(f"simulated recordings in {shown(folder)}")
    return folder
