"""What is in a workspace: lineage, what is stale, what is unfinished or damaged."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

from plop.artifacts.lineage import Key, first_difference, parents, stale_reasons
from plop.artifacts.store import Artifact, Store
from plop.artifacts.suggestions import workspaces_near
from plop.artifacts.verify import obvious_damage, verify
from plop.errors import PlopError
from plop.pipeline.execute import raw_content
from plop.pipeline.registry import places, stage_ref
from plop.pipeline.settings import resolve, settings_of
from plop.pipeline.settings_file import flat_values
from plop.pipeline.stage import Stage
from plop_cli.console import Console, format_seconds
from plop_cli.next_step import next_step


def show_status(store: Store, console: Console, *, everything: bool) -> None:
    """Print a table for each environment, one row an artifact in the order of the pipeline, then what is amiss.

    Older artifacts are shown only with `everything`. Last comes the next sensible command.

    Raises:
        PlopError: There is no such folder.
    """
    if not store.workspace.is_dir():
        store.check_begun()
    artifacts = store.artifacts()
    reasons = _stale(store, artifacts)
    shown = artifacts if everything else _latest_lines(artifacts)
    damage = {artifact.key: error for artifact in shown if (error := obvious_damage(artifact)) is not None}
    rows = [_row(store, artifact, reasons, damage) for artifact in sorted(shown, key=_place)]
    for environment, group in groupby(rows, key=lambda row: row["environment"]):
        console.table(
            [{**row, "environment": "", "state": row["state"].partition(":")[0]} for row in group], title=environment
        )
        console.say("")
    for artifact in sorted(shown, key=_place):
        reason = reasons.get(artifact.key, "is stale")
        if not reason.endswith("is stale"):  # what only follows from another one is said there
            console.say(f"stale: {artifact.address}: {reason}")
    for error in damage.values():
        console.warn(error.render())
    if len(shown) < len(artifacts):
        console.say(f"{len(artifacts) - len(shown)} older artifacts are not shown; --all shows them")
    for stage, fingerprint in unfinished(store):
        console.say(f"unfinished: {stage}@{fingerprint[:8]}; the same command goes on with it")
    problems = store.unreadable()
    for error in problems.values():
        console.warn(error.render())
    if not artifacts and not problems:
        near = ", ".join(f"-w {path}" for path in workspaces_near(store.workspace)[:3])
        console.say(f"no artifacts in {store.root}" + (f"; perhaps {near}" if near else ""))
    step = next_step(
        shown, stale=reasons, unfinished=unfinished(store), damaged=list(damage), workspace=store.workspace
    )
    console.say(f"next: {step.command}   ({step.why})")
    console.result(
        {
            "next": {"command": step.command, "why": step.why},
            "artifacts": rows,
            "unfinished": ["@".join(key) for key in unfinished(store)],
            "unreadable": [error.as_dict() for error in problems.values()],
        }
    )


def _stale(store: Store, artifacts: list[Artifact]) -> dict[Key, str]:
    """Say why artifacts are stale, as far as their stages can be imported here."""
    stages = _imported_stages(artifacts)
    versions = {name: stage.version for name, stage in stages.items()}

    def raw_digest(artifact: Artifact, name: str, path: Path) -> str | None:
        command = _command(artifact)
        stage = stages.get(command)
        if stage is None:
            return None
        known = {setting.key for setting in settings_of(stage.config)}
        recorded = {key: value for key, value in flat_values(artifact.manifest.config) if key in known}
        config = resolve(stage.config, command, ("manifest", recorded))
        return raw_content(store, stage, path, config)

    reasons = stale_reasons(store, artifacts, versions, raw_digest)
    store.cache.save()
    return reasons


def unfinished(store: Store) -> list[Key]:
    """List the scratch folders of runs that go on or were killed."""
    found = sorted(store.root.glob("*/.partial-*")) if store.root.is_dir() else []
    return [(path.parent.name, path.name.removeprefix(".partial-")) for path in found]


def _latest_lines(artifacts: list[Artifact]) -> list[Artifact]:
    latest: dict[Any, Artifact] = {}
    for artifact in artifacts:
        latest[artifact.manifest.stage, artifact.manifest.environment, artifact.manifest.config.get("seed")] = artifact
    keep = {artifact.key for artifact in latest.values()}
    by_key = {artifact.key: artifact for artifact in artifacts}
    todo = list(keep)
    while todo:
        key = todo.pop()
        for parent in parents(by_key[key]).values():
            if parent in by_key and parent not in keep:
                keep.add(parent)
                todo.append(parent)
    return [artifact for artifact in artifacts if artifact.key in keep]


def _place(artifact: Artifact) -> tuple[str, int]:
    return artifact.manifest.environment, places().get(artifact.manifest.stage, len(places()))


def _row(store: Store, artifact: Artifact, reasons: dict[Key, str], damage: dict[Key, PlopError]) -> dict[str, Any]:
    manifest = artifact.manifest
    full = "@".join(artifact.key)
    names = [name for name, address in store.names().items() if address == full]
    sources = [f"{stage}@{mark[:6]}" for stage, mark in parents(artifact).values()]
    sources += [str(facts["name"]) for facts in manifest.inputs.values() if "name" in facts]
    state = f"stale: {reasons[artifact.key]}" if artifact.key in reasons else "current"
    if artifact.key in damage:
        state = f"damaged: {damage[artifact.key].where}"
    return {
        "environment": manifest.environment,
        "artifact": artifact.address,
        "name": ", ".join(names),
        "from": ", ".join(sources),
        "took": format_seconds(float(manifest.provenance.get("seconds", 0.0))),
        "MB": round(sum(manifest.sizes.values()) / 1e6, 1),
        "state": state,
    }


def _command(artifact: Artifact) -> str:
    return str(artifact.manifest.provenance.get("command", artifact.manifest.stage))


def _imported_stages(artifacts: list[Artifact]) -> dict[str, Stage]:
    """Import the stages of the artifacts, by command and by name; one that cannot be imported is left out."""
    found: dict[str, Stage] = {}
    for artifact in artifacts:
        command = _command(artifact)
        if command not in found:
            try:
                found[command] = stage_ref(command).load()
            except (ImportError, KeyError, OSError):
                continue
            found.setdefault(artifact.manifest.stage, found[command])
    return found


def show_difference(store: Store, console: Console, one: str, two: str) -> None:
    """Print the first difference between two artifacts."""
    difference = first_difference(store, store.find(one), store.find(two))
    console.say(difference or f"{one} and {two} have the same settings, inputs and content")
    console.result({"difference": difference})


def verify_all(store: Store, console: Console, addresses: list[str]) -> None:
    """Read every payload file again and compare it with the manifest.

    Raises:
        PlopError: One artifact is damaged, or several are.
    """
    store.check_begun()
    chosen = [store.find(address) for address in addresses] if addresses else store.artifacts()
    damaged = [] if addresses else list(store.unreadable().values())
    for artifact in chosen:
        try:
            verify(artifact, store.cache, fresh=True)
        except PlopError as error:
            damaged.append(error)
        else:
            console.say(f"{artifact.address}  {len(artifact.manifest.files)} files are as they were written")
    store.cache.save()
    if len(damaged) == 1:
        raise damaged[0]
    if damaged:
        raise PlopError(f"{len(damaged)} artifacts are damaged.", found="\n".join(error.render() for error in damaged))
    console.result({"verified": [artifact.address for artifact in chosen]})
