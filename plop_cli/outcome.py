"""Output of a stage's command: for a run, and for a dry run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from plop.artifacts.fingerprint import plain
from plop.artifacts.store import Artifact, Store
from plop.pipeline.execute import Outcome, Plan, plan
from plop.pipeline.tasks import Need, Task, addresses, given, in_order, needs
from plop_cli.console import Console, format_seconds

IS_THERE = "exists already"


def report(console: Console, store: Store, outcome: Outcome, name: str | None = None) -> None:
    """Show the outcome of a run; `name`: the value of --name."""
    manifest = outcome.artifact.manifest
    path = outcome.artifact.path.relative_to(store.workspace)
    for text in manifest.summary.get("warnings", []):
        console.warn(text)
    state = "exists already, nothing to do" if outcome.skipped else f"done in {format_seconds(outcome.seconds)}"
    console.say(f"{outcome.artifact.address}  {state}  ({path})")
    if outcome.name_from is not None:
        stage, _, mark = outcome.name_from.partition("@")
        console.say(f"the name {name} moved: {stage}@{mark[:8]} -> {outcome.artifact.address}")
    console.table([{"figure": k, "value": v} for k, v in manifest.summary.get("figures", {}).items()])
    console.table(manifest.summary.get("table", []))
    console.result(outcome_facts(outcome))


def outcome_facts(outcome: Outcome) -> dict[str, Any]:
    """Return the `--json` output of a run."""
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
    """Describe a run that starts, and its inputs: "train: recordings calibrate@299d65b4 (block, 5 episodes), ..."."""
    sources = []
    for name, artifact in planned.inputs.artifacts.items():
        episodes = artifact.manifest.summary.get("figures", {}).get("episodes")
        facts = [artifact.manifest.environment, f"{episodes} episodes" if isinstance(episodes, int) else ""]
        details = ", ".join(fact for fact in facts if fact)
        sources.append(f"{name} {artifact.address}" + (f" ({details})" if details else ""))
    sources += [f"{name} {path}" for name, path in planned.inputs.raw.items()]
    known = "" if planned.last_seconds is None else f"; {_last(planned.last_seconds)}"
    return f"{planned.command}: {', '.join(sources)}{known}"


def report_plan(console: Console, store: Store, task: Task) -> None:
    """Show what a run would do, and which inputs would be made before it."""
    before, known = in_order(task.before), store.journal.last_seconds(task.ref.name)
    address, existing = _address(store, task)
    console.say(f"{address or task.ref.command}  {IS_THERE if existing else f'would run; {_last(known)}'}")
    sources = {name: _sources(value) for name, value in task.inputs.items() if value}
    console.table([{"input": name, "from": source} for name, source in sources.items()])
    console.table(planned_rows(store, before), title="before it")
    console.result(
        {
            "address": address,
            "would_run": not existing,
            "last_seconds": known,
            "inputs": sources,
            "would_run_first": [one.ref.command for one in before if one.there is None],
            "config": plain(task.config),
        }
    )


def planned_rows(store: Store, tasks: Sequence[Task]) -> list[dict[str, str]]:
    """Describe for each run whether it would run, its inputs, and its last duration."""
    return [
        {
            "run": _source(task) if task.there is not None else f"plop {task.ref.command}",
            "from": ", ".join(_sources(value) for value in task.inputs.values() if value),
            "state": IS_THERE
            if task.there is not None and not task.force
            else f"would run; {_last(store.journal.last_seconds(task.ref.name))}",
        }
        for task in tasks
    ]


def _address(store: Store, task: Task) -> tuple[str | None, bool]:
    """Return the address of a run's artifact, unless something else runs first, and whether it exists."""
    if task.waits:
        return None, False
    stage = task.ref.load()
    made = {one: "@".join(one.there.key) for one in task.before if one.there is not None}
    inputs = given(addresses(task, made))
    planned = plan(stage, store=store, config=task.config, inputs=inputs, command=task.ref.command, force=task.force)
    return f"{stage.name}@{planned.fingerprint[:8]}", planned.existing is not None


def _sources(value: Need) -> str:
    """Describe an input: addresses, a path, or the commands that would make it."""
    return ", ".join(_source(one) for one in needs(value)) or str(value)


def _source(one: Task | Artifact) -> str:
    if isinstance(one, Task):
        return one.there.address if one.there is not None else f"`plop {one.ref.command}`"
    return one.address


def _last(seconds: float | None) -> str:
    return "it has not run in this workspace yet" if seconds is None else f"its last run took {format_seconds(seconds)}"


def show_times(console: Console, outcomes: Mapping[str, Outcome]) -> None:
    """Print the duration of each stage; for existing artifacts the original one."""
    rows = [{"stage": stage, "time": _time(outcome)} for stage, outcome in outcomes.items()]
    whole = sum(outcome.seconds for outcome in outcomes.values())
    console.table([*rows, {"stage": "all", "time": format_seconds(whole)}], title="time")


def _time(outcome: Outcome) -> str:
    if not outcome.skipped:
        return format_seconds(outcome.seconds)
    return f"kept (took {format_seconds(float(outcome.artifact.manifest.provenance.get('seconds', 0.0)))})"
