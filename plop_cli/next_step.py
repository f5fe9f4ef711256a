"""The next sensible command, from what a workspace holds."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from plop.artifacts.lineage import Key
from plop.artifacts.store import Artifact
from plop.pipeline.registry import commands, places


@dataclass(frozen=True)
class NextStep:
    """What to type, and why."""

    command: str
    why: str


AFTER = {
    "ingest": ("calibrate", "are the cameras right? A verdict for each, before anything is made from them"),
    "simulate": ("fuse", "simulated cameras are right: one object cloud of each episode"),
    "calibrate": ("fuse", "one object cloud of each episode"),
    "fuse": ("fit-init", "Gaussians of object and tool"),
    "fit-init": ("train", "a dynamics model; `plop identify` fits the engine's material instead"),
    "train": ("rollout", "predict the test episodes"),
    "filter": ("identify", "fit the engine's material to what was followed"),
    "identify": ("compare", "where and when the model is wrong"),
    "rollout": ("eval", "score the predictions"),
    "eval": ("compare", "where and when the model is wrong; `plop report` writes one page of it"),
    "compare": ("diagnose", "which physical effect the model is missing"),
    "diagnose": ("augment", "add the effect that was named to the model; `plop report` writes one page of it"),
    "augment": ("report", "one page with everything that was found"),
}
"""What follows on the most advanced stage of a line: stage -> (command, why)."""
_COMPARING = ("compare", "diagnose")
_MODELS = ("augment", "identify", "train")


def next_step(
    artifacts: Sequence[Artifact],
    *,
    stale: Mapping[Key, str],
    unfinished: Sequence[Key] = (),
    damaged: Sequence[Key] = (),
    workspace: Path | None = None,
) -> NextStep:
    """Choose the next command: repair, then go on with what was begun, then renew, then the next stage.

    Args:
        artifacts: Those that count, least recently used first.
        stale: Why artifacts are stale; what is only stale because of another one ends in "is stale".
        unfinished: Stage and fingerprint of runs that were stopped.
        damaged: Keys of artifacts with missing or changed files.
        workspace: Their folder, which the command names unless it is the current one.
    """
    place = _option(workspace)
    if not artifacts and not unfinished:
        return NextStep(
            f"plop ingest FOLDER{place}",
            "begins with your recordings, and guesses their format; `plop demo` shows a whole run on simulated ones",
        )
    several = len({artifact.manifest.environment for artifact in artifacts}) > 1
    by_stage = sorted(artifacts, key=lambda artifact: places().get(artifact.key[0], len(places())))
    for artifact in by_stage:
        if artifact.key in damaged:
            return NextStep(_again(artifact, several) + " --force" + place, f"{artifact.address} is damaged")
    if unfinished:
        stage = unfinished[-1][0]
        return NextStep(f"plop {stage}{place}", "goes on with the run that was stopped: give it the same options")
    for artifact in by_stage:
        reason = stale.get(artifact.key, "is stale")
        if not reason.endswith("is stale"):
            return NextStep(_again(artifact, several) + place, f"{artifact.address} is stale: {reason}")
    return _onward(artifacts, several, place)


def _onward(artifacts: Sequence[Artifact], several: bool, place: str) -> NextStep:
    """Go on with the line of the artifact that was used last."""
    environment = artifacts[-1].manifest.environment
    line = [artifact for artifact in artifacts if artifact.manifest.environment == environment]
    stages = {artifact.key[0]: artifact for artifact in line}
    chosen = _environment(line[-1], several)
    last = max(stages, key=lambda name: places().get(name, -1))
    if last == "filter" and "train" in stages:
        last = "train"
    if last == "calibrate" and _only_bad(stages[last]):
        return NextStep(
            f"plop calibrate --handeye FOLDER{chosen}{place}", "every camera is bad: mend them first, see the verdicts"
        )
    if last == "report":
        pages = sorted(path.name for path in stages[last].path.glob("*.html"))
        return NextStep(
            f"plop export {stages[last].address} OUT{place}",
            f"all stages were run; the page is {', '.join(pages) or stages[last].path}",
        )
    command, why = AFTER.get(last, ("--help", "lists the commands"))
    models = [artifact.address for artifact in line if artifact.key[0] in _MODELS]
    if command in _COMPARING and models:
        command += f" --model {models[-1]}"
    return NextStep(f"plop {command}{chosen}{place}", why)


def _environment(artifact: Artifact, several: bool) -> str:
    """Write the option that a command needs where the workspace holds several environments."""
    return f" --env {shlex.quote(artifact.manifest.environment)}" if several else ""


def _only_bad(calibration: Artifact) -> bool:
    figures = calibration.manifest.summary.get("figures", {})
    others = sum(int(figures.get(f"cameras_{kind}") or 0) for kind in ("good", "corrected", "unchecked"))
    return not others and bool(figures.get("cameras_bad"))


def _again(artifact: Artifact, several: bool) -> str:
    """Write the command that makes an artifact again, with its raw input; settings that were typed are not repeated."""
    told = artifact.manifest.provenance
    command = str(told.get("command", artifact.key[0]))
    raw = [str(path) for path in dict(told.get("raw_paths", {})).values()]
    known = commands()
    words = command.split() if command in known else [artifact.key[0]]
    takes_path = words[0] in ("ingest", "simulate")
    typed = shlex.join(["plop", *words, *(raw[:1] if takes_path else [])])
    return typed + ("" if takes_path else _environment(artifact, several))


def _option(workspace: Path | None) -> str:
    if workspace is None or workspace.resolve() == Path.cwd():
        return ""
    near = os.path.relpath(workspace)
    return f" -w {shlex.quote(str(workspace) if near.startswith('..') else near)}"
