"""Atomic writing of files: a file is complete or absent."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def in_the_way(folder: Path) -> Path | None:
    """Return the file that blocks a folder or one of its parents; None when nothing does."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    return None if there.is_dir() else there


def scratch_of(path: Path) -> Path:
    """Name under which this process writes a file until it is complete; two processes may write the same file."""
    return path.with_name(f"{path.name}.{os.getpid()}.tmp")


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a scratch name beside `path` to write to, which takes the final name when the block ends well.

    A killed run leaves no incomplete file under the final name, and an earlier file stays; a block
    that fails leaves no scratch file either.

    Args:
        path: The file; its folder is made when it does not exist.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    scratch = scratch_of(path)
    try:
        yield scratch
        os.replace(scratch, path)
    except BaseException:
        scratch.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text atomically."""
    with whole(path) as scratch:
        scratch.write_text(text, encoding="utf-8")


def write_json(path: Path, content: Mapping[str, Any] | Sequence[Any], *, sort_keys: bool = True) -> None:
    """Write JSON atomically.

    Args:
        path: The file.
        content: JSON types.
        sort_keys: Order the keys by name rather than as given.
    """
    write_text(path, json.dumps(content, indent=1, sort_keys=sort_keys))
