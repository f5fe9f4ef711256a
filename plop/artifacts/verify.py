"""Verification of a payload: sizes always, digests once and whenever a file was modified."""

from __future__ import annotations

from plop.artifacts.digest import DigestCache
from plop.artifacts.store import Artifact
from plop.errors import PlopError


def verify(artifact: Artifact, cache: DigestCache, *, fresh: bool = False) -> None:
    """Compare every payload file with the manifest.

    Args:
        artifact: What to check.
        cache: Digests of files that have not changed since they were last read.
        fresh: Read every file again, whatever the cache says.

    Raises:
        PlopError: A file is missing, or has another size or content.
    """
    for name, expected in artifact.manifest.files.items():
        _check_size(artifact, name)
        try:
            found = cache.digest(artifact.path / name, fresh=fresh)
        except OSError as error:
            raise _corrupted(artifact, name, "a readable file", error.strerror or str(error)) from error
        if found != expected:
            raise _corrupted(artifact, name, f"sha256 {expected[:12]}...", f"sha256 {found[:12]}...")


def obvious_damage(artifact: Artifact) -> PlopError | None:
    """Return what is wrong with a payload without reading it: a file is missing or has another size."""
    try:
        for name in artifact.manifest.files:
            _check_size(artifact, name)
    except PlopError as error:
        return error
    return None


def _check_size(artifact: Artifact, name: str) -> None:
    try:
        found = (artifact.path / name).stat().st_size
    except OSError as error:
        raise _corrupted(artifact, name, "a readable file", error.strerror or str(error)) from error
    size = artifact.manifest.sizes.get(name)
    if size is not None and found != size:
        raise _corrupted(artifact, name, f"{size} bytes", f"{found} bytes")


def _corrupted(artifact: Artifact, name: str, expected: str, found: str) -> PlopError:
    command = artifact.manifest.provenance.get("command", artifact.manifest.stage)
    return PlopError(
        f"The payload of {artifact.address} is damaged.",
        where=artifact.path / name,
        expected=expected,
        found=found,
        fix=f"Run `plop {command}` with --force and the same options to make it again.",
    )
