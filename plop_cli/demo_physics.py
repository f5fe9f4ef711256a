"""The missing-physics demo, offline: hide an effect, seal the answer, diagnose it, add it, compare the errors."""

from __future__ import annotations

import importlib.resources
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from plop.artifacts.result_file import to_json
from plop.artifacts.store import Store
from plop.diagnosis.decision.result import Diagnosis
from plop.errors import PlopError
from plop.physics.scenes.sealed import open_answer
from plop_cli.console import Console, format_seconds
from plop_cli.pictures import input_of, say_videos, shown, worst_picture

PROFILE = "demo-physics.toml"
Command = Callable[[list[str]], int]


def run_demo_physics(workspace: Path, console: Console, run: Command, *, seed: int) -> None:
    """Run the commands of a user in sequence; existing artifacts are kept.

    Args:
        workspace: Folder of the demo.
        console: Output of the demo.
        run: Runs one `plop` command line and returns its exit code.
        seed: Seed of the motions and the hidden effect.

    Raises:
        PlopError: A command failed.
    """
    started = time.perf_counter()
    workspace = Store(workspace).workspace
    workspace.mkdir(parents=True, exist_ok=True)
    settings = workspace / "plop.toml"
    if not settings.is_file():
        shipped = importlib.resources.files("plop.pipeline") / "profiles" / PROFILE
        settings.write_text(shipped.read_text(encoding="utf-8"))
    steps = Steps(workspace, console, run)
    steps("simulate", "quick-block.toml", "--seed", str(100 + seed), "--name", "plain")
    steps("identify", "--recordings", "plain", "--split", "all", "--name", "base")
    console.say("The same motions again: what the model misses anyway is then in both sets, and cancels.")
    hidden = ("--hide", "random", "--snr", "5", "--seed", str(200 + seed), "--motions-seed", str(100 + seed))
    steps("simulate", "quick-block.toml", *hidden, "--name", "mystery")
    steps("compare", "--model", "base", "--recordings", "mystery")
    steps("diagnose", "--model", "base", "--recordings", "mystery", "--name", "verdict")
    store = Store(workspace)
    verdict = Diagnosis.load(store.find("verdict").path).verdict
    console.say(f"\nVERDICT  {verdict.text}")
    answer = open_answer(store.find("mystery").path)
    console.say(f"ANSWER   {_answer_text(answer)}\n")
    models = ["base"]
    if verdict.kind.can_be_added:
        name = verdict.named[0]
        models.append(f"base+{name}")
        steps("augment", "--model", "base", "--effect", name, "--diagnosis", "verdict", "--name", models[-1])
    for model in models:
        steps("eval", "--model", model, "--recordings", "mystery", "--name", f"scores-{model}")
    steps("report", "--models", ",".join(models), "--recordings", "mystery", "--name", "report")
    console.say(f"all in {format_seconds(time.perf_counter() - started)}")
    console.result(
        {
            "verdict": to_json(verdict),
            "answer": answer,
            "models": models,
            **_say_pictures(Store(workspace), console, models[-1]),
            "seconds": round(time.perf_counter() - started, 1),
        }
    )


def _say_pictures(store: Store, console: Console, model: str) -> dict[str, Any]:
    """Print the paths of the report, a picture of it, and the videos of the last model; return the paths."""
    report = store.find("report")
    page = next(report.path.glob("*.html"))
    still = worst_picture(input_of(store, report, "comparisons.0"))
    videos = say_videos(console, input_of(store, store.find(f"scores-{model}"), "rollouts"))
    console.say(f"report: {shown(page)}")
    if still is not None:
        console.say(f"  picture of the error of base: {shown(still)}")
    return {"report": str(page), "report_still": None if still is None else str(still), **videos}


class Steps:
    """Runs command lines and shows each before it runs."""

    def __init__(self, workspace: Path, console: Console, run: Command) -> None:
        self.workspace, self.console, self.run = workspace, console, run

    def __call__(self, *words: str) -> None:
        """Run one command in the workspace.

        Raises:
            PlopError: It failed; its own message has the reason.
        """
        self.console.say(f"$ plop {' '.join(words)}")
        options = ["--quiet"] if self.console.quiet or self.console.as_json else []
        code = self.run([*words, "-w", str(self.workspace), *options])
        if code != 0:
            raise PlopError(
                "A step of the demo failed.",
                where=f"plop {' '.join(words)}",
                found=f"exit code {code}",
                fix="Follow the message above and run the demo again.",
            )


def _answer_text(answer: dict[str, Any]) -> str:
    effects = "; ".join(
        f"{name}: " + ", ".join(f"{k} = {v:.4g}" for k, v in values.items())
        for name, values in answer["effects"].items()
    )
    return f"hidden was {effects or 'nothing'} (moves the object by {1000 * answer['rms_m']:.2f} mm RMS)"
