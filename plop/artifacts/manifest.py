"""The manifest: what an artifact is, how it was made and what it holds."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path, PurePosixPath
from typing import Any

from plop.errors import PlopError

MANIFEST_SCHEMA = 1
"""Increased when older code could no longer read the manifest."""

MANIFEST_NAME = "manifest.json"

LOGS = ("tensorboard", "logs")
"""Folders of a payload, at any depth, with times and host names: kept and verified, but not part of the content."""


@dataclass(frozen=True)
class Manifest:
    """Everything that is known about one artifact, stored as manifest.json beside its payload."""

    stage: str
    fingerprint: str
    """Hash of stage, stage version, configuration and input contents; the artifact's address."""
    stage_version: int
    config: dict[str, Any]
    """Resolved configuration, seed included."""
    inputs: dict[str, dict[str, Any]]
    """Per input: {"stage", "fingerprint", "content"} for an artifact, {"name", "content"} for a raw path."""
    files: dict[str, str] = field(default_factory=dict)
    """Payload: relative path -> sha256 of the content."""
    summary: dict[str, Any] = field(default_factory=dict)
    """Figures, table and warnings of the stage."""
    provenance: dict[str, Any] = field(default_factory=dict)
    """Versions, seconds taken, time of day, raw paths: facts that are not part of the fingerprint."""
    schema: int = MANIFEST_SCHEMA
    sizes: dict[str, int] = field(default_factory=dict)
    """Payload: relative path -> bytes, for a fast check."""
    environment: str = ""
    """What the artifact is about, e.g. "prism-jelly"; inherited from the inputs."""

    @property
    def address(self) -> str:
        """Short address for people, e.g. `train@3f9a1c04`."""
        return f"{self.stage}@{self.fingerprint[:8]}"


def content_files(manifest: Manifest) -> dict[str, str]:
    """Return the files that make up the content: all but the logs."""
    logs = set(LOGS)
    return {name: digest for name, digest in manifest.files.items() if logs.isdisjoint(PurePosixPath(name).parts[:-1])}


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write manifest.json into an artifact's folder; figures and columns stay in the order that the stage gave them."""
    text = json.dumps(asdict(manifest), indent=1)
    (folder / MANIFEST_NAME).write_text(text + "\n", encoding="utf-8")


def read_manifest(folder: Path) -> Manifest:
    """Read manifest.json from an artifact's folder.

    Raises:
        PlopError: It is missing, damaged, or written by a newer plop.
    """
    path = folder / MANIFEST_NAME
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        schema = int(facts["schema"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise PlopError(
            "The artifact's manifest cannot be read.",
            where=path,
            expected="the manifest.json that plop wrote",
            found=f"{type(error).__name__}: {error}",
            fix=f"Make it again: {_make_again(folder)}",
        ) from error
    if schema > MANIFEST_SCHEMA:
        raise PlopError(
            "The artifact was written by a newer plop.",
            where=path,
            expected=f"manifest schema {MANIFEST_SCHEMA} or older",
            found=f"manifest schema {schema}",
            fix=f"Use the newer plop. Or make the artifact again with this one: {_make_again(folder)}",
        )
    known = {f.name for f in fields(Manifest)}
    try:
        manifest = Manifest(**{key: value for key, value in facts.items() if key in known})
    except TypeError as error:
        raise PlopError(
            "The artifact's manifest is incomplete.",
            where=path,
            found=str(error),
            fix=f"Make it again: {_make_again(folder)}",
        ) from error
    for name in manifest.files:
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            raise PlopError(
                "The artifact's manifest names a file outside its folder.",
                where=path,
                expected="relative paths",
                found=name,
                fix="Do not use this artifact.",
            )
    return manifest


def _make_again(folder: Path) -> str:
    return f"run the command that made it with --force, or remove {folder} and run the command again."
