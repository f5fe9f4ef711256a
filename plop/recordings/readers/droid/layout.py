"""Find DROID raw episodes on the disk: <LAB>/{success|failure}/<date>/<time>/."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from plop.errors import PlopError
from plop.recordings.readers.side_file import read_json

OUTCOMES = ("success", "failure")


@dataclass(frozen=True)
class DroidFolder:
    """One episode's folder, with the facts from its path and metadata."""

    name: str
    """Unique name, safe as a file name: <LAB>_<date and time>."""
    root: Path
    """The raw folder; no file outside of it is read."""
    folder: Path
    lab: str
    outcome: str
    """"success", "failure" or "" where the path has neither."""
    metadata: dict[str, Any] = field(default_factory=dict)
    """The metadata file; empty when there is none."""
    warnings: tuple[str, ...] = ()

    @property
    def trajectory(self) -> Path:
        """The robot's data."""
        return self.folder / "trajectory.h5"

    @property
    def recordings(self) -> Path:
        """The folder of the videos."""
        return self.folder / "recordings"

    @property
    def stamp(self) -> str:
        """Date and time as metadata write them, "2023-08-06-22h-13m-04s"; "" when the folder has another name."""
        return stamp_of(self.folder.name)

    def matches_uuid(self, uuid: str) -> bool:
        """Return whether a key of a side file refers to this episode, even without a metadata file."""
        known = self.metadata.get("uuid")
        if known:
            return uuid == known
        return bool(self.stamp) and uuid.startswith(self.lab + "+") and uuid.endswith(self.stamp)


def find_episodes(root: str | Path) -> list[DroidFolder]:
    """List every folder that is, or looks like, an episode, sorted by path.

    Args:
        root: The raw folder: any level from the data set down to one episode.

    Returns:
        Episodes with unique names, including damaged ones: reading them reports the error.

    Raises:
        PlopError: There is no such folder, or no episode in it.
    """
    root = Path(root)
    if not root.is_dir():
        raise PlopError(
            "There is no such folder of DROID episodes.",
            where=root,
            expected="a folder",
            found="a file" if root.exists() else "nothing",
            fix="Correct the path.",
        )
    found: list[DroidFolder] = []
    taken: set[str] = set()
    for path, folders, files in os.walk(root):
        folders.sort()
        metadata = sorted(name for name in files if name.startswith("metadata_") and name.endswith(".json"))
        if "trajectory.h5" in files or metadata or "recordings" in folders:
            folders.clear()
            found.append(_describe(root, Path(path), metadata, taken))
    if not found:
        raise PlopError(
            "No DROID episode was found.",
            where=root,
            expected="<LAB>/{success|failure}/<date>/<time>/trajectory.h5 below this folder",
            found="no trajectory.h5, metadata_*.json or recordings/",
            fix="Give the folder that contains the labs.",
        )
    return found


def inside(root: Path, relative: str, *, base: Path | None = None, where: str) -> Path:
    """Resolve a path from a file, and reject one outside the raw folder.

    One exception is data of the set itself: in the cache of the Hugging Face hub every file of
    `<set>/snapshots/<revision>/` is a link to `<set>/blobs/<digest>` of the same `<set>`.

    Args:
        root: The raw folder.
        relative: The path as written.
        base: Folder that it is relative to; the raw folder when absent.
        where: File and key that contain it, for the message.

    Returns:
        The path with its own name and suffix, links not resolved.

    Raises:
        PlopError: The path is absolute, or it or the target of its link lies outside the raw folder.
    """
    path = (base or root) / relative
    within = path.resolve().is_relative_to(root.resolve()) or _is_blob_of_its_set(path, root)
    if Path(relative).is_absolute() or not within:
        led = not Path(relative).is_absolute() and Path(os.path.abspath(path)).is_relative_to(root.absolute())
        raise PlopError(
            "A path points outside the raw folder.",
            where=where,
            expected=f"a relative path inside {root}",
            found=relative + (", a link to the outside" if led else ""),
            fix="Copy the file into the raw folder and use a relative path.",
        )
    return path


def _is_blob_of_its_set(path: Path, root: Path) -> bool:
    """Return whether a file in the raw folder is a link into the blobs of its own hub cache."""
    folder = path.parent.resolve()
    if not path.is_symlink() or not folder.is_relative_to(root.resolve()):
        return False
    caches = [parent.parent for parent in (folder, *folder.parents) if parent.parent.name == "snapshots"]
    return any(path.resolve().parent == cache.parent / "blobs" for cache in caches)


def stamp_of(folder_name: str) -> str:
    """Read an asctime folder name (`Sun_Aug__6_22:13:04_2023`, or with `_` for `:`) as 2023-08-06-22h-13m-04s."""
    parts = re.match(r"^[A-Za-z]{3}_+([A-Za-z]{3})_+(\d{1,2})_(\d{2})[:_](\d{2})[:_](\d{2})_(\d{4})$", folder_name)
    if parts is None:
        return ""
    try:
        moment = datetime.strptime(" ".join(parts.groups()), "%b %d %H %M %S %Y")
    except ValueError:
        return ""
    return moment.strftime("%Y-%m-%d-%Hh-%Mm-%Ss")


def _describe(root: Path, folder: Path, metadata_files: list[str], taken: set[str]) -> DroidFolder:
    parts = folder.resolve().parts
    outcome = next((part for part in reversed(parts) if part in OUTCOMES), "")
    lab = parts[len(parts) - 1 - parts[::-1].index(outcome) - 1] if outcome else ""
    metadata, warnings = _read_metadata(folder, metadata_files)
    lab = str(metadata.get("lab") or lab)
    base = re.sub(r"[^A-Za-z0-9.-]+", "_", f"{lab}_{stamp_of(folder.name) or folder.name}").strip("_.")
    name, count = base, 2
    while name in taken:
        name, count = f"{base}_{count}", count + 1
    taken.add(name)
    return DroidFolder(name, root, folder, lab, outcome, metadata, tuple(warnings))


def _read_metadata(folder: Path, files: list[str]) -> tuple[dict[str, Any], list[str]]:
    if not files:
        return {}, [f"{folder}: no metadata_*.json; cameras and intrinsics are found by other files"]
    path = folder / files[0]
    warnings = [f"{folder}: {len(files)} metadata files, {files[0]} is used"] if len(files) > 1 else []
    try:
        content = read_json(path)
    except (OSError, ValueError) as error:
        return {}, [*warnings, f"{path}: not readable ({error}); ignored"]
    if not isinstance(content, dict):
        return {}, [*warnings, f"{path}: not a JSON object; ignored"]
    if "droid_version" not in content and "r2d2_version" not in content:
        warnings.append(f"{path}: neither droid_version nor r2d2_version; read as DROID anyway")
    return content, warnings
