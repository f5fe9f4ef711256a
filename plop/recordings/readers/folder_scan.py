"""A quick scan of a folder: enough to recognise its format, independent of its size."""

from __future__ import annotations

import json
import zipfile
from collections import deque
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any

_FOLDERS, _NAMES, _DEPTH = 400, 400, 6
"""Largest number of folders, of names in each, and of levels: DROID's trajectories lie five levels down."""


@dataclass(frozen=True)
class FolderScan:
    """Content below a path; a file is treated as a folder with only this file."""

    path: Path

    @cached_property
    def names(self) -> list[str]:
        """Files and folders below, "a/b.c" and "a/b/", nearest first; no hidden ones, no links to folders."""
        if self.path.is_file():
            return [self.path.name]
        found: list[str] = []
        todo, looked = deque([(self.path, "", 0)]), 0
        while todo and looked < _FOLDERS:
            # alternate between the nearest and the deepest folder: a large data set has too many for one order alone
            folder, prefix, depth = todo.popleft() if looked % 2 else todo.pop()
            looked += 1
            try:
                entries = sorted(entry for entry in folder.iterdir() if not entry.name.startswith("."))
            except OSError:
                continue
            for entry in entries[:_NAMES]:
                inside = entry.is_dir()
                found.append(f"{prefix}{entry.name}{'/' if inside else ''}")
                if inside and not entry.is_symlink() and depth < _DEPTH:
                    todo.append((entry, f"{prefix}{entry.name}/", depth + 1))
        return sorted(found, key=lambda name: (name.rstrip("/").count("/"), name))

    def find(self, *patterns: str) -> list[str]:
        """Return the names that match a pattern, compared with the end of the path: "meta/info.json", "*.npz"."""
        lower = [(name, name.lower().rstrip("/")) for name in self.names]
        return [
            name
            for pattern in patterns
            for name, low in lower
            if fnmatchcase(low, pattern) or fnmatchcase(low, f"*/{pattern}")
        ]

    def at(self, name: str) -> Path:
        """Return the path of a name."""
        return self.path if self.path.is_file() else self.path / name

    def folder(self, name: str, up: int = 1) -> Path:
        """Return the folder `up` levels above a name."""
        return self.at(name.rstrip("/")).parents[up - 1]

    def json(self, name: str) -> dict[str, Any]:
        """Read a JSON object; {} when it is not one."""
        try:
            content = json.loads(self.at(name).read_text(encoding="utf-8-sig"))
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}

    def npz_keys(self, name: str) -> set[str]:
        """Names of the arrays in an npz file; none when it cannot be read."""
        try:
            with zipfile.ZipFile(self.at(name)) as archive:
                return {entry.removesuffix(".npy") for entry in archive.namelist()}
        except (OSError, zipfile.BadZipFile):
            return set()

    def hdf5_has(self, name: str, *keys: str) -> bool:
        """Return whether an HDF5 file has all of some keys."""
        import h5py

        try:
            with h5py.File(self.at(name), "r") as file:
                return all(key in file for key in keys)
        except (OSError, RuntimeError):
            return False
