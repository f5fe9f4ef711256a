"""The commit of a finished run: its scratch folder becomes the artifact's folder in one rename."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

from plop.artifacts.digest import file_digest
from plop.artifacts.manifest import MANIFEST_NAME, Manifest, write_manifest
from plop.errors import PlopError


def committed(scratch: Path, final: Path, manifest: Manifest) -> Manifest:
    """Hash the payload of a scratch folder, write its manifest, and rename the folder.

    Args:
        scratch: The scratch folder; hidden entries and `*.tmp` files in it are discarded.
        final: Folder of the artifact; an existing one is replaced.
        manifest: Its manifest, without the files of the payload.

    Returns:
        The manifest with the files of the payload.

    Raises:
        PlopError: The payload contains a link.
    """
    _drop_traces(scratch)
    files, sizes = {}, {}
    for path in sorted(scratch.rglob("*")):
        if path.is_symlink():
            raise PlopError("A stage left a link in its payload.", where=path, expected="files and folders")
        if path.is_file() and path != scratch / MANIFEST_NAME:
            name = path.relative_to(scratch).as_posix()
            _flush(path)
            files[name], sizes[name] = file_digest(path), path.stat().st_size
    whole = replace(manifest, files=files, sizes=sizes)
    write_manifest(scratch, whole)
    _flush(scratch / MANIFEST_NAME)
    set_aside = _set_aside(final)
    if final.exists():
        os.replace(final, set_aside)
    os.replace(scratch, final)
    shutil.rmtree(set_aside, ignore_errors=True)
    return whole


def restore(final: Path) -> None:
    """Undo an interrupted `committed`: keep the new folder if it is in place, otherwise restore the old one."""
    set_aside = _set_aside(final)
    if set_aside.exists():
        if final.exists():
            shutil.rmtree(set_aside)
        else:
            os.replace(set_aside, final)


def _set_aside(final: Path) -> Path:
    return final.with_name(f".old-{final.name}")


def _drop_traces(scratch: Path) -> None:
    for path in sorted(scratch.rglob("*")):
        if path.name.startswith(".") or path.suffix == ".tmp":
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    """Flush a file to the disk, so that a power failure cannot leave a finished artifact without content."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
