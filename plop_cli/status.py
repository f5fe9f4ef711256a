"""Status of a workspace: lineage, stale, unfinished and damaged artifacts."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

from plop.artifacts.difference import first_difference
from plop.artifacts.lineage import Key, check_lineage, parents
from plop.artifacts.stale import Stale
from plop.artifacts.store import Artifact, Store
from plop.artifacts.succession import latest_lines
from plop.artifacts.suggestions import workspaces_near
from plop.artifacts.verify import obvious_damage, verify
from plop.errors import PlopError
from plop.pipeline.registry import places
from plop.pipeline.staleness import stale
from plop_cli.console import Console, format_seconds
from plop_cli.next_step import next_step


def show_status(store: Store, console: Console, *, everything: bool) -> None:
    """Print a tree for each environment, each artifact below its input, then all problems.

    Older artifacts are shown only with `everything`. The last line is the next sensible command.

    Raises:
        PlopError: There is no such folder.
    """
    if not store.workspace.is_dir():
        store.check_begun()
    artifacts, circle = _sound(store.artifacts())
    reasons = stale(store, artifacts)
    shown = artifacts if everything else latest_lines(artifacts, store.names())
    damage = {artifact.key: error for artifact in shown if (error := obvious_damage(artifact)) is not None}
    rows = [_row(store, artifact, reasons, damage) | {"branch": branch} for branch, artifact in _tree(shown)]
    for environment, group in groupby(rows, key=lambda row: row["environment"]):
        console.table([_shown(row) for row in group], title=environment, unbroken="artifact")
        console.say("")
    for artifact in sorted(shown, key=_place):
        reason = reasons.get(artifact.key)
        if reason is not None and not reason.follows:  # a consequence of another stale artifact is reported there
            console.say(f"stale: {artifact.address}: {reason.text}")
    problems = [*damage.values(), *store.unreadable().values(), *circle]
    for error in problems:
        console.warn(error.render())
    if older := len(artifacts) - len(shown):
        console.say(f"{older} older artifacts are not shown; --all shows them, `plop gc` lists what can be removed")
    for stage, fingerprint in unfinished(store):
        console.say(f"unfinished: {stage}@{fingerprint[:8]}; the same command resumes it")
    if not artifacts and not problems:
        near = ", ".join(f"-w {path}" for path in workspaces_near(store.workspace)[:3])
        console.say(f"no artifacts in {store.root}" + (f"; perhaps {near}" if near else ""))
    step = next_step(shown, stale=reasons, unfinished=unfinished(store), damaged=damage, workspace=store.workspace)
    console.say(f"next: {step.command}   ({step.why})")
    console.result(
        {
            "next": {"command": step.command, "why": step.why},
            "artifacts": [{key: value for key, value in row.items() if key != "branch"} for row in rows],
            "unfinished": ["@".join(key) for key in unfinished(store)],
            "unreadable": [error.as_dict() for error in problems[len(damage) :]],
        }
    )


def _sound(artifacts: list[Artifact]) -> tuple[list[Artifact], list[PlopError]]:
    """Leave out artifacts that descend from themselves; return the rest, and the errors of these."""
    wrong = []
    while True:
        known = {artifact.key: artifact for artifact in artifacts}
        try:
            check_lineage(known)
        except PlopError as error:
            wrong.append(error)
            artifacts = [a for a in artifacts if a.path != Path(str(error.where)).parent]
        else:
            return artifacts, wrong


def unfinished(store: Store) -> list[Key]:
    """List the scratch folders of runs that are active or were killed."""
    found = sorted(store.root.glob("*/.partial-*")) if store.root.is_dir() else []
    return [(path.parent.name, path.name.removeprefix(".partial-")) for path in found]


def _tree(artifacts: list[Artifact]) -> list[tuple[str, Artifact]]:
    """Order artifacts so that each follows the most advanced one of its inputs; with the branches of the tree."""
    by_key = {artifact.key: artifact for artifact in artifacts}
    below: dict[Key | None, list[Artifact]] = {}
    for artifact in sorted(artifacts, key=_place):
        same = [by_key[key] for key in parents(artifact).values() if key in by_key]
        same = [one for one in same if one.manifest.environment == artifact.manifest.environment]
        above = max(same, key=_place).key if same else None
        below.setdefault(above, []).append(artifact)
    found: list[tuple[str, Artifact]] = []

    def visit(artifact: Artifact, branch: str, indent: str) -> None:
        found.append((branch, artifact))
        children = below.get(artifact.key, [])
        for child in children:
            last = child is children[-1]
            visit(child, indent + ("└ " if last else "├ "), indent + ("  " if last else "│ "))

    for root in below.get(None, []):
        visit(root, "", "")
    return found


def _place(artifact: Artifact) -> tuple[str, int]:
    return artifact.manifest.environment, places().get(artifact.manifest.stage, len(places()))


def _row(store: Store, artifact: Artifact, reasons: dict[Key, Stale], damage: dict[Key, PlopError]) -> dict[str, Any]:
    manifest = artifact.manifest
    full = "@".join(artifact.key)
    names = [name for name, address in store.names().items() if address == full]
    sources = [f"{stage}@{mark[:6]}" for stage, mark in parents(artifact).values()]
    sources += [str(facts["name"]) for facts in manifest.inputs.values() if "name" in facts]
    state = f"stale: {reasons[artifact.key].text}" if artifact.key in reasons else "current"
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


def _shown(row: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of the tree; inputs are drawn, and raw data is named at the root."""
    name = row["name"] if row["branch"] else f"{row['name']} ({row['from']})".strip()
    figures = {"took": row["took"], "MB": row["MB"], "state": row["state"].partition(":")[0]}
    return {"artifact": row["branch"] + row["artifact"], "name": name, **figures}


def show_difference(store: Store, console: Console, one: str, two: str) -> None:
    """Print the first difference between two artifacts."""
    difference = first_difference(store, store.find(one), store.find(two))
    console.say(difference or f"{one} and {two} have the same settings, inputs and content")
    console.result({"difference": difference})


def verify_all(store: Store, console: Console, addresses: list[str]) -> None:
    """Read every payload file again and compare it with the manifest.

    Raises:
        PlopError: One or several artifacts are damaged.
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
            console.say(f"{artifact.address}  {len(artifact.manifest.files)} files are unchanged")
    store.cache.save()
    if len(damaged) == 1:
        raise damaged[0]
    if damaged:
        raise PlopError(f"{len(damaged)} artifacts are damaged.", found="\n".join(error.render() for error in damaged))
    console.result({"verified": [artifact.address for artifact in chosen]})
