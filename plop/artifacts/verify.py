"""Is an artifact's payload what its stage wrote? Sizes always, digests once and whenever a file was touched."""

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
        path = artifact.path / name
        size = artifact.manifest.sizes.get(name)
        try:
            found_size = path.stat().st_size
            if size is not None and found_size != size:
                raise _corrupted(artifact, name, f"{size} bytes", f"{found_size} bytes")
            found = cache.digest(path, fresh=fresh)
        except OSError as error:
            raise _corrupted(artifact, name, "a readable file", error.strerror or str(error)) from error
        if found != expected:
            raise _corrupted(artifact, name, f"sha256 {expected[:12]}...", f"sha256 {found[:12]}...")


def _corrupted(artifact: Artifact, name: str, expected: str, found: str) -> PlopError:
    return PlopError(
        f"The payload of {artifact.address} is damaged.",
        where=artifact.path / name,
        expected=expected,
        found=found,
        fix=f"Run `plop {artifact.manifest.stage} --force` with the same settings to make it again.",
    )
