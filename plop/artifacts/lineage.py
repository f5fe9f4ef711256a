"""Lineage: which artifacts an artifact comes from, whether it is stale, and how two differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plop.artifacts.digest import content_digest
from plop.artifacts.fingerprint import flat_values
from plop.artifacts.manifest import MANIFEST_NAME, Manifest, content_files
from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError

Key = tuple[str, str]


@dataclass(frozen=True)
class Stale:
    """Why an artifact no longer matches the present state of the workspace."""

    text: str
    follows: bool = False
    """Only because one of its inputs is stale."""


RawDigest = Callable[[Artifact, str, Path], str | None]
"""(artifact, input name, raw path) -> digest of the present content; None when it is unknown."""
LEFT_OUT = "none"
"""Value of an optional input that must not be used."""


def parents(artifact: Artifact) -> dict[str, Key]:
    """Return the artifacts that were read, by input name; raw inputs are left out."""
    return {
        name: (str(facts["stage"]), str(facts["fingerprint"]))
        for name, facts in artifact.manifest.inputs.items()
        if "fingerprint" in facts
    }


def made_from(made: Manifest, name: str, own: Manifest) -> bool:
    """Return whether an artifact was made from another, or from one of the same content; True where this is unknown.

    Args:
        made: The artifact.
        name: Name of the input.
        own: The expected input.
    """
    source = made.inputs.get(name, {})
    known = "fingerprint" in source and source["fingerprint"] != own.fingerprint
    return not known or source.get("content") == content_digest(content_files(own))


def recordings_content(manifest: Manifest | None) -> list[str]:
    """Return the content digests of recordings and of those they were made from (calibrated ones: as ingested).

    Two sets may have episodes of the same names; sets that share a digest are the same recordings.

    Args:
        manifest: Of recordings; None gives an empty list.
    """
    if manifest is None:
        return []
    return [
        content_digest(content_files(manifest)),
        *([str(manifest.inputs["recordings"]["content"])] if "recordings" in manifest.inputs else []),
    ]


def closure(known: Mapping[Key, Artifact], artifact: Artifact) -> set[Key]:
    """Return an artifact and all its ancestors that are known."""
    seen: set[Key] = set()
    todo = [artifact]
    while todo:
        current = todo.pop()
        if current.key not in seen:
            seen.add(current.key)
            seen.update(key for key in parents(current).values() if key not in known)
            todo += [known[key] for key in parents(current).values() if key in known]
    return seen


def check_lineage(known: Mapping[Key, Artifact]) -> None:
    """Reject artifacts that descend from themselves: no run makes such, so a manifest was edited by hand.

    Raises:
        PlopError: One of them does; names the manifests of the cycle.
    """
    whole: set[Key] = set()

    def visit(key: Key, above: tuple[Key, ...]) -> None:
        if key in above:
            line = [known[each].address for each in (*above[above.index(key) :], key)]
            raise PlopError(
                "An artifact descends from itself: a manifest was edited by hand.",
                where=known[key].path / MANIFEST_NAME,
                expected="inputs that are older than the artifact",
                found=" <- ".join(reversed(line)),
                fix=f"Remove {known[key].path} and make it again.",
            )
        if key not in whole and key in known:
            for parent in parents(known[key]).values():
                visit(parent, (*above, key))
            whole.add(key)

    for key in known:
        visit(key, ())


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
    replaced by a more recent artifact (see `_Succession`). One of an older version is as good as one of the present
    version with the same content, as after an update that changed nothing there.

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


def replacements(known: Mapping[Key, Artifact], names: Mapping[str, str]) -> dict[Key, Artifact]:
    """Map each artifact to its replacement: a later one with other content; itself where there is none.

    Args:
        known: All artifacts, least recently used first.
        names: Name -> full address.
    """
    latest = _Succession(known, names).latest()
    return {
        key: old if new.content == old.content or _differ_in_seed_only(new, old) else new
        for key, old in known.items()
        for new in [latest[key]]
    }


def latest_lines(artifacts: list[Artifact], names: Mapping[str, str]) -> list[Artifact]:
    """Keep the latest of each stage, environment and seed, named ones, and the ancestors of these.

    Args:
        artifacts: All artifacts, least recently used first.
        names: Name -> full address.
    """
    by_key = {artifact.key: artifact for artifact in artifacts}
    latest = {(a.manifest.stage, a.manifest.environment, a.manifest.config.get("seed")): a for a in artifacts}
    named = [a for a in artifacts if "@".join(a.key) in set(names.values())]
    keep = set().union(*(closure(by_key, a) for a in [*latest.values(), *named]))
    return [artifact for artifact in artifacts if artifact.key in keep]


class _Succession:
    """Which artifact replaced which.

    A more recent artifact of the same stage replaces another one when it was made from the same things: from the same
    environment and raw inputs, and, input by input, from the same artifact or one that replaced it. A name keeps what
    has it: sets of recordings, models and verdicts with names of their own coexist, and so does everything
    made from them, until the name is given to another one.
    """

    def __init__(self, known: Mapping[Key, Artifact], names: Mapping[str, str]) -> None:
        """Index all artifacts, least recently used first; names: name -> "<stage>@<fingerprint>"."""
        self._known = known
        self._age = {key: place for place, key in enumerate(known)}
        self._named = set(names.values())
        self._found: dict[tuple[Key, Key], bool] = {}

    def latest(self) -> dict[Key, Artifact]:
        """Return the most recent replacement of each."""
        alike: dict[tuple[str, frozenset[str]], list[Artifact]] = {}
        for artifact in self._known.values():
            alike.setdefault((artifact.key[0], self._raw(artifact)), []).append(artifact)
        return {
            old.key: next(new for new in reversed(group) if new is old or self._replaced(old.key, new.key))
            for group in alike.values()
            for old in group
        }

    def _replaced(self, old: Key, new: Key) -> bool:
        if old == new:
            return True
        if (old, new) not in self._found:
            self._found[old, new] = self._newer(old, new) and self._made_alike(old, new)
        return self._found[old, new]

    def _newer(self, old: Key, new: Key) -> bool:
        known = old in self._known and new in self._known
        return known and old[0] == new[0] and "@".join(old) not in self._named and self._age[old] < self._age[new]

    def _made_alike(self, old: Key, new: Key) -> bool:
        before, after = parents(self._known[old]), parents(self._known[new])
        return all(name in after and self._replaced(key, after[name]) for name, key in before.items())

    def _raw(self, artifact: Artifact) -> frozenset[str]:
        found = {artifact.manifest.environment}
        for key in closure(self._known, artifact):
            first = self._known.get(key)
            if first is not None and not parents(first):
                found |= {str(facts.get("name", "")) for facts in first.manifest.inputs.values()}
        return frozenset(found)


def _differ_in_seed_only(one: Artifact, two: Artifact) -> bool:
    """Two seeds of the same thing coexist; neither replaces the other."""
    a, b = one.manifest, two.manifest
    seedless = [{key: value for key, value in m.config.items() if key != "seed"} for m in (a, b)]
    return a.config != b.config and seedless[0] == seedless[1] and a.inputs == b.inputs


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


def first_difference(store: Store, one: Artifact, two: Artifact) -> str | None:
    """Name the first difference of two artifacts, starting from the raw data; None when they are equal."""
    a, b = one.manifest, two.manifest
    pair = f"{one.address} and {two.address}"
    if a.stage != b.stage:
        return f"{pair} are of different stages: {a.stage}, {b.stage}"
    for name in sorted(a.inputs.keys() | b.inputs.keys()):
        difference = _input_difference(store, one, two, name)
        if difference:
            return difference
    if a.stage_version != b.stage_version:
        return f"{pair}: stage version {a.stage_version}, {b.stage_version}"
    ours, theirs = dict(flat_values(a.config)), dict(flat_values(b.config))
    for key in sorted(ours.keys() | theirs.keys()):
        left, right = ours.get(key, "(absent)"), theirs.get(key, "(absent)")
        if left != right:
            return f"{pair}: setting {a.stage}.{key} = {left!r}, {right!r}"
    left_files, right_files = content_files(a), content_files(b)
    for name in sorted(left_files.keys() | right_files.keys()):
        if left_files.get(name) != right_files.get(name):
            where = "in both" if name in left_files and name in right_files else "only in one"
            return f"{pair}: same settings and inputs, but {name} differs ({where}): the stage is not deterministic"
    return None


def _input_difference(store: Store, one: Artifact, two: Artifact, name: str) -> str | None:
    a, b = one.manifest.inputs.get(name), two.manifest.inputs.get(name)
    pair = f"{one.address} and {two.address}"
    if a is None or b is None:
        return f"{pair}: only {(two if a is None else one).address} has an input {name}"
    if a["content"] == b["content"]:
        return None
    if "fingerprint" not in a or "fingerprint" not in b:
        sources = ", ".join(str(facts.get("name", facts.get("stage"))) for facts in (a, b))
        return f"{pair}: the raw input {name} differs ({sources})"
    if a["stage"] != b["stage"]:
        return f"{pair}: {name} comes from {a['stage']}, {b['stage']}"
    left, right = store.get(a["stage"], a["fingerprint"]), store.get(b["stage"], b["fingerprint"])
    if left is None or right is None or left.key == right.key:
        return f"{pair}: {name} = {a['stage']}@{a['fingerprint'][:8]}, {b['stage']}@{b['fingerprint'][:8]}"
    return first_difference(store, left, right)
