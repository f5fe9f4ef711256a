"""Why an artifact no longer matches the present state of its workspace."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plop.artifacts.lineage import Key, check_lineage, parents
from plop.artifacts.store import Artifact, Store
from plop.artifacts.succession import replacements
from plop.errors import PlopError


@dataclass(frozen=True)
class Stale:
    """Why an artifact no longer matches the present state of the workspace."""

    text: str
    follows: bool = False
    """Only because one of its inputs is stale."""


RawDigest = Callable[[Artifact, str, Path], str | None]
"""(artifact, input name, raw path) -> digest of the present content; None when it is unknown."""


def raw_path(store: Store, artifact: Artifact, name: str) -> Path | None:
    """Return where a raw input was when the artifact was made."""
    where = artifact.manifest.provenance.get("raw_paths", {}).get(name)
    return None if where is None else store.workspace / where


def stale_reasons(
    store: Store, artifacts: list[Artifact], versions: Mapping[str, int], raw_digest: RawDigest
) -> dict[Key, Stale]:
    """Explain why artifacts no longer match the present state of the workspace; current ones are left out.

    An artifact is stale when its stage has a new version, a raw input has changed or is gone, an input is
    gone, was made again with another content, is stale itself (unless another one that is not holds the same), or was
    replaced by a more recent artifact (see `plop.artifacts.succession`). One of an older version is as good as one of
    the present version with the same content, as after an update that changed nothing there.

    Args:
        store: The workspace.
        artifacts: All artifacts, least recently used first.
        versions: Version of each stage as the code has it now.
        raw_digest: Digest of a raw input as it is now.
    """
    by_key = {a.key: a for a in artifacts}
    check_lineage(by_key)
    successors = replacements(by_key, store.names())
    alike: dict[tuple[str, str], list[Artifact]] = {}
    for one in artifacts:
        alike.setdefault((one.key[0], one.content), []).append(one)
    reasons: dict[Key, Stale] = {}
    visited: set[Key] = set()

    def is_stale(source: Artifact) -> bool:
        for twin in alike[source.key[0], source.content]:
            visit(twin)
        return all(twin.key in reasons for twin in alike[source.key[0], source.content])

    def visit(artifact: Artifact) -> None:
        if artifact.key in visited:
            return
        visited.add(artifact.key)
        for key in parents(artifact).values():
            if key in by_key:
                visit(by_key[key])
        reason = own_reason(artifact)
        if reason:
            reasons[artifact.key] = reason

    def own_reason(artifact: Artifact) -> Stale | None:
        manifest = artifact.manifest
        version = versions.get(manifest.stage, manifest.stage_version)
        if all(version != twin.manifest.stage_version for twin in alike[artifact.key[0], artifact.content]):
            return Stale(f"the stage is now version {version}, this is of version {manifest.stage_version}")
        for name, facts in manifest.inputs.items():
            if "fingerprint" in facts:
                reason = _input_reason(name, facts, by_key, successors, is_stale)
            else:
                reason = _raw_reason(store, artifact, name, facts, raw_digest)
            if reason:
                return reason
        return None

    for artifact in artifacts:
        visit(artifact)
    return reasons


def _input_reason(
    name: str,
    facts: Mapping[str, Any],
    by_key: Mapping[Key, Artifact],
    successors: Mapping[Key, Artifact],
    is_stale: Callable[[Artifact], bool],
) -> Stale | None:
    key = (str(facts["stage"]), str(facts["fingerprint"]))
    source = by_key.get(key)
    if source is None:
        return Stale(f"its {name} {key[0]}@{key[1][:8]} is gone")
    if source.content != facts["content"]:
        return Stale(f"its {name} {source.address} was made again and differs")
    if is_stale(source):
        return Stale(f"its {name} {source.address} is stale", follows=True)
    latest = successors[key]
    return None if latest is source else Stale(f"its {name} {source.address} was replaced by {latest.address}")


def _raw_reason(
    store: Store, artifact: Artifact, name: str, facts: Mapping[str, Any], raw_digest: RawDigest
) -> Stale | None:
    path = raw_path(store, artifact, name)
    if path is None:
        return None
    if not path.exists():
        return None  # raw data may be removed once it has been ingested
    try:
        now = raw_digest(artifact, name, path)
    except (PlopError, OSError) as error:
        return Stale(f"its {name} folder cannot be read: {error}")
    return None if now in (None, facts["content"]) else Stale(f"the files in its {name} folder have changed")
