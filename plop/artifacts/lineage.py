"""Lineage: which artifacts an artifact comes from."""

from __future__ import annotations

from collections.abc import Mapping

from plop.artifacts.digest import content_digest
from plop.artifacts.manifest import MANIFEST_NAME, Manifest, content_files
from plop.artifacts.store import Artifact
from plop.errors import PlopError

Key = tuple[str, str]


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
