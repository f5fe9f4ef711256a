"""Content digests of files and folders, and a cache that avoids reading them twice."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from plop.artifacts.atomic_file import write_text
from plop.errors import PlopError

SETTLED_AFTER_S = 2.0
"""A file changed this recently could change again within one tick of its clock: its digest is not cached."""


def file_digest(path: Path) -> str:
    """Hash the content of one file; sha256 in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def content_digest(files: Mapping[str, str]) -> str:
    """Hash a set of files given as relative path -> sha256: names and contents, nothing else."""
    whole = hashlib.sha256()
    for name in sorted(files):
        whole.update(f"{name}\0{files[name]}\n".encode())
    return whole.hexdigest()


def files_below(path: Path) -> list[Path]:
    """List the files of a raw input: the file itself, or every visible file below a folder, sorted.

    Raises:
        PlopError: The path does not exist, or the folder is empty.
    """
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise PlopError("There is no such file or folder.", where=path, fix="Correct the path.")
    found = []
    for folder, names, leaves in os.walk(path):
        names[:] = sorted(name for name in names if not name.startswith("."))
        found += [Path(folder) / leaf for leaf in sorted(leaves) if not leaf.startswith(".")]
    if not found:
        raise PlopError("The folder holds no files.", where=path, fix="Correct the path.")
    return found


class DigestCache:
    """Digests of files by path, size and modification time; kept outside every fingerprint."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._known: dict[str, list[object]] = self._load()
        self._changed = False

    def _load(self) -> dict[str, list[object]]:
        try:
            known = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return known if isinstance(known, dict) else {}

    def digest(self, path: Path, *, fresh: bool = False) -> str:
        """Hash a file, or return its cached hash when size and time are unchanged; `fresh` always reads it."""
        facts = path.stat()
        key = os.path.relpath(path, self.path.parent)
        entry = self._known.get(key)
        if not fresh and entry is not None and entry[:2] == [facts.st_size, facts.st_mtime_ns]:
            return str(entry[2])
        value = file_digest(path)
        if time.time() - facts.st_mtime > SETTLED_AFTER_S:
            self._known[key] = [facts.st_size, facts.st_mtime_ns, value]
            self._changed = True
        return value

    def raw_digest(self, root: Path, files: Iterable[Path]) -> str:
        """Hash a raw input: the given files, named relative to `root`."""
        base = root if root.is_dir() else root.parent
        return content_digest({path.relative_to(base).as_posix(): self.digest(path) for path in files})

    def save(self) -> None:
        """Write the cache; a cache that cannot be written is not an error."""
        if not self._changed:
            return
        with suppress(OSError):
            write_text(self.path, json.dumps(self._known))
            self._changed = False
