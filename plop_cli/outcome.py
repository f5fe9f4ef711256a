"""What a stage's command tells: of a run, and of one that was only planned."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plop.artifacts.fingerprint import plain
from plop.artifacts.lineage import LEFT_OUT
from plop.artifacts.store import Store
from plop.pipeline.execute import Outcome, Plan
from plop.pipeline.stage import Stage
from plop_cli.console import Console, format_seconds


def report(console: Console, store: Store, outcome: Outcome, name: str | None = None) -> None:
    """Show what a run made; `name`: what it was called by --name."""
    manifest = outcome.artifact.manifest
    path = outcome.artifact.path.relative_to(store.workspace)
    for text in manifest.summary.get("warnings", []):
        console.warn(text)
    state = "already there, nothing to do" if outcome.skipped else f"done in {format_seconds(outcome.seconds)}"
    console.say(f"{outcome.artifact.address}  {state}  ({path})")
    if outcome.name_from is not None:
        stage, _, mark = outcome.name_from.partition("@")
        console.say(f"the name {name} moved: {stage}@{mark[:8]} -> {outcome.artifact.address}")
    console.table([{"figure": k, "value": v} for k, v in manifest.summary.get("figures", {}).items()])
    console.table(manifest.summary.get("table", []))
    console.result(outcome_facts(outcome))


def outcome_facts(outcome: Outcome) -> dict[str, Any]:
    """Give what `--json` prints of a run."""
    manifest = outcome.artifact.manifest
    return {
        "stage": manifest.stage,
        "address": outcome.artifact.address,
        "fingerprint": manifest.fingerprint,
        "path": str(outcome.artifact.path),
        "environment": manifest.environment,
        "skipped": outcome.skipped,
        "name_moved_from": outcome.name_from,
        "seconds": round(outcome.seconds, 3),
        "config": manifest.config,
        "inputs": manifest.inputs,
        **manifest.summary,
    }


def begins(planned: Plan) -> str:
    """Say what is going to run, and on what: "train: recordings calibrate@299d65b4 (block, 5 episodes), ..."."""
    sources = []
    for name, artifact in planned.inputs.artifacts.items():
        episodes = artifact.manifest.summary.get("figures", {}).get("episodes")
        facts = [artifact.manifest.environment, f"{episodes} episodes" if isinstance(episodes, int) else ""]
        told = ", ".join(fact for fact in facts if fact)
        sources.append(f"{name} {artifact.address}" + (f" ({told})" if told else ""))
    sources += [f"{name} {path}" for name, path in planned.inputs.raw.items()]
    known = "" if planned.last_seconds is None else f"; {_last(planned.last_seconds)}"
    return f"{planned.command}: {', '.join(sources)}{known}"


def report_plan(console: Console, planned: Plan) -> None:
    """Show what a run would do."""
    address = f"{planned.stage.name}@{planned.fingerprint[:8]}"
    inputs = {name: a.address for name, a in planned.inputs.artifacts.items()}
    inputs |= {name: str(path) for name, path in planned.inputs.raw.items()}
    known = planned.last_seconds
    console.say(f"{address}  {'is already there' if planned.existing else f'would run; {_last(known)}'}")
    console.table([{"input": name, "from": source} for name, source in inputs.items()])
    console.result(
        {
            "address": address,
            "would_run": planned.existing is None,
            "last_seconds": known,
            "inputs": inputs,
            "config": plain(planned.config),
        }
    )


def report_unplanned(
    console: Console,
    store: Store,
    command: str,
    stage: Stage,
    inputs: Mapping[str, str | Path],
    first: Mapping[str, str],
    config: Any,
) -> None:
    """Show what a run would do for which something else would run first, so that its address is not known yet.

    Args:
        console: Where to show it.
        store: The workspace.
        command: The command of the stage.
        stage: What would run.
        inputs: What is there, by input name.
        first: Input -> command that would make it.
        config: The settings.
    """
    known = store.journal.last_seconds(stage.name)
    there: dict[str, str] = {}
    for name, source in inputs.items():
        spec = stage.inputs.get(name)
        if source != LEFT_OUT and spec is not None:
            one = spec.stages and not spec.many
            there[name] = store.find(str(source)).address if one else str(source)
    console.say(f"{command}  would run, and what it needs first; {_last(known)}")
    sources = there | {name: f"`plop {maker}` would run first" for name, maker in first.items()}
    console.table([{"input": name, "from": sources[name]} for name in stage.inputs if name in sources])
    console.result(
        {
            "address": None,
            "would_run": True,
            "last_seconds": known,
            "inputs": there,
            "would_run_first": dict(first),
            "config": plain(config),
        }
    )


def _last(seconds: float | None) -> str:
    return "it has not run here yet" if seconds is None else f"its last run took {format_seconds(seconds)}"


def show_times(console: Console, outcomes: Mapping[str, Outcome]) -> None:
    """Print how long each stage took, and of those that were there already how long they took when they were made."""
    rows = [{"stage": stage, "time": _time(outcome)} for stage, outcome in outcomes.items()]
    whole = sum(outcome.seconds for outcome in outcomes.values())
    console.table([*rows, {"stage": "all", "time": format_seconds(whole)}], title="time")


def _time(outcome: Outcome) -> str:
    if not outcome.skipped:
        return format_seconds(outcome.seconds)
    return f"kept (took {format_seconds(float(outcome.artifact.manifest.provenance.get('seconds', 0.0)))})"
