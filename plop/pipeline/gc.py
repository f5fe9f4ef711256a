"""Garbage collection of a workspace: superseded artifacts that nothing needs, and remains of killed runs."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from plop.artifacts.lineage import check_lineage, closure
from plop.artifacts.lock import note_of
from plop.artifacts.store import Artifact, Store
from plop.artifacts.succession import latest_lines

LEFTOVERS = {
    ".partial-": "left by a run that was stopped",
    ".old-": "replaced by a run that was killed",
    ".gone-": "partly removed",
}
"""Prefixes of hidden folders beside the artifacts of a stage, and their origin."""


@dataclass(frozen=True)
class Removable:
    """One item that can be removed."""

    path: Path
    stage: str
    fingerprint: str
    why: str
    size: int
    """Bytes on the disk."""

    @property
    def address(self) -> str:
        """Short address."""
        return f"{self.stage}@{self.fingerprint[:8]}"


def removable(store: Store) -> list[Removable]:
    """List the items that can be removed, in the order of the workspace.

    Kept are named artifacts, and the latest of each stage, environment and seed, each with all its ancestors, and
    outputs and inputs of active runs. If a manifest cannot be read, the ancestors of its artifact are unknown, and all
    artifacts are kept.

    Raises:
        PlopError: An artifact descends from itself.
    """
    artifacts = store.artifacts()
    known = {artifact.key: artifact for artifact in artifacts}
    check_lineage(known)
    kept = {artifact.key for artifact in latest_lines(artifacts, store.names())}
    for key in store.read_by_others() & known.keys():
        kept |= closure(known, known[key])
    old = [] if store.unreadable() else [a for a in artifacts if a.key not in kept]
    return [*(_superseded(one) for one in old if not _in_use(store, *one.key)), *_leftovers(store)]


def remove(store: Store, wanted: list[Removable]) -> list[Removable]:
    """Remove the items that can still be removed; return them."""
    with store.removing():  # no run starts to read during search and removal
        still = {one.path for one in removable(store)}
        gone = [one for one in wanted if one.path in still]
        aside = [one.path.with_name(f".gone-{one.path.name.lstrip('.')}") for one in gone]
        for one, path in zip(gone, aside, strict=True):
            os.replace(one.path, path)
    for path in aside:
        shutil.rmtree(path)
    return gone


def _superseded(artifact: Artifact) -> Removable:
    return Removable(artifact.path, *artifact.key, "neither the latest nor needed by it", _size(artifact.path))


def _leftovers(store: Store) -> Iterator[Removable]:
    for folder in sorted(store.root.glob("*/.*")):
        prefix = next((known for known in LEFTOVERS if folder.name.startswith(known)), None)
        if prefix is None or not folder.is_dir():
            continue
        stage, mark = folder.parent.name, folder.name.removeprefix(prefix)
        lost = prefix == ".old-" and not store.final_path(stage, mark).is_dir()  # it is restored when the run continues
        if not lost and not _in_use(store, stage, mark):
            yield Removable(folder, stage, mark, LEFTOVERS[prefix], _size(folder))


def _in_use(store: Store, stage: str, fingerprint: str) -> bool:
    return note_of(store.lock_path(stage, fingerprint)) is not None


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
