"""The main demo, offline: simulate a small set, run every stage on it, show scores, video and times."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from plop.artifacts.layouts import ScoreFiles
from plop.artifacts.store import Store
from plop.pipeline.chain import chain, check_layers, layers_of, read_profile
from plop.pipeline.execute import Outcome
from plop.pipeline.graph import Graph
from plop.pipeline.tasks import Runner
from plop.pipeline.upstream import Planner
from plop_cli.console import Console
from plop_cli.listener import Chained
from plop_cli.outcome import show_times
from plop_cli.pictures import say_videos, shown

BEGIN, TARGET = "ingest mesh", "eval"


def run_demo(store: Store, console: Console, *, seed: int, assignments: list[str]) -> None:
    """Run the demo; finished stages of an earlier, stopped run are kept."""
    layers = layers_of(store, read_profile("demo"), assignments)
    check_layers(layers, Graph().chain(TARGET, begin=BEGIN))
    raw = _simulate(store.workspace, console, seed)
    listener = Chained(console)
    tasks = chain(Planner(store, listener), layers, target=TARGET, begin=BEGIN, raw=raw)
    done: dict[str, Outcome] = {}
    for task, outcome in Runner(store, lambda _: listener).run([tasks[TARGET]]):
        assert isinstance(outcome, Outcome)
        done[task.ref.command] = outcome
    scores = done[TARGET].artifact
    console.table(scores.manifest.summary.get("table", []), title="scores")
    show_times(console, done)
    pictures = say_videos(console, done["rollout"].artifact)
    files = ScoreFiles(scores.path)
    for picture in files.pictures:
        console.say(f"  first, middle and last frame: {shown(picture)}")
    console.say(f"scores: {shown(files.report)}, over time: {shown(files.over_time)}")
    seconds = {name: outcome.seconds for name, outcome in done.items()}
    console.result({"scores": scores.manifest.summary, **pictures, "seconds": seconds})


def _simulate(workspace: Path, console: Console, seed: int) -> Path:
    """Write the raw recordings once; a folder under the final name is complete."""
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
