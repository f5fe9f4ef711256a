"""The next sensible command, from the content of a workspace."""

from __future__ import annotations

import os
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from plop.artifacts.lineage import Key
from plop.artifacts.stale import Stale
from plop.artifacts.store import Artifact
from plop.pipeline.registry import pipeline, places
from plop.pipeline.stage import Choice
from stages import MODELS, NEXT


@dataclass(frozen=True)
class NextStep:
    """A command and the reason for it."""

    command: str
    why: str


def next_step(
    artifacts: Sequence[Artifact],
    *,
    stale: Mapping[Key, Stale],
    unfinished: Sequence[Key] = (),
    damaged: Collection[Key] = (),
    workspace: Path | None = None,
) -> NextStep:
    """Choose the next command: repair, resume an unfinished run, remake stale artifacts, or the next stage.

    Args:
        artifacts: Relevant artifacts, least recently used first.
        stale: Why artifacts are stale.
        unfinished: Stage and fingerprint of runs that were stopped.
        damaged: Keys of artifacts with missing or changed files.
        workspace: Their folder, which the command names unless it is the current one.
    """
    place = _option(workspace)
    if not artifacts and not unfinished:
        return NextStep(
            f"plop ingest FOLDER{place}",
            "starts with your recordings, and detects their format; `plop demo` shows a whole run on simulated ones",
        )
    by_stage = sorted(artifacts, key=lambda artifact: places().get(artifact.key[0], len(places())))
    for artifact in by_stage:
        if artifact.key in damaged:
            return NextStep(f"plop repro{place}", f"remakes {artifact.address}, which is damaged")
    if unfinished:
        stage = unfinished[-1][0]
        return NextStep(f"plop {stage}{place}", "resumes the run that was stopped: use the same options")
    for artifact in by_stage:
        if artifact.key in stale and not stale[artifact.key].follows:
            return NextStep(
                f"plop repro{place}",
                f"remakes stale artifacts with the same settings: {artifact.address}, {stale[artifact.key].text}",
            )
    return _onward(artifacts, place)


def _onward(artifacts: Sequence[Artifact], place: str) -> NextStep:
    """Continue with the lineage of the artifact that was used last."""
    environment = artifacts[-1].manifest.environment
    line = [artifact for artifact in artifacts if artifact.manifest.environment == environment]
    stages = {artifact.key[0]: artifact for artifact in line}
    several = len({artifact.manifest.environment for artifact in artifacts}) > 1
    chosen = f" --env {shlex.quote(environment)}" if several else ""
    repaired = artifacts[-1] if artifacts[-1].key[0] == "repair" else None
    last = "repair" if repaired else max(stages, key=lambda name: places().get(name, -1))
    if last == "filter" and "train" in stages:
        last = "train"
    if last == "calibrate" and _only_bad(stages[last]):
        return NextStep(
            f"plop calibrate --handeye FOLDER{chosen}{place}",
            "every camera is bad: repair them first, see the verdicts",
        )
    if last not in NEXT:
        page = next(iter(sorted(stages[last].path.glob("*.html"))), stages[last].path).name
        return NextStep(f"plop export {stages[last].address} OUT{place}", f"all stages are done; the page is {page}")
    models = [artifact.address for artifact in line if artifact.key[0] in MODELS]
    following = NEXT[last] if models or not repaired else NEXT["calibrate"]
    ref = next(ref for ref in pipeline() if ref.name == following)
    model = ref.load().inputs.get("model") if models else None
    named = f" --model {models[-1]}" if model is not None and model.choice is Choice.ANY_LINE and model.read else ""
    recordings = f" --recordings {repaired.address}" if repaired else ""  # beside those with the fault
    return NextStep(f"plop {ref.command}{named}{recordings}{chosen}{place}", ref.help)


def _only_bad(calibration: Artifact) -> bool:
    figures = calibration.manifest.summary.get("figures", {})
    others = sum(int(figures.get(f"cameras_{kind}") or 0) for kind in ("good", "corrected", "unchecked"))
    return not others and bool(figures.get("cameras_bad"))


def _option(workspace: Path | None) -> str:
    if workspace is None or workspace.resolve() == Path.cwd():
        return ""
    near = os.path.relpath(workspace)
    return f" -w {shlex.quote(str(workspace) if near.startswith('..') else near)}"
