"""Vertices of PLY files, read and written by plyfile; the caller interprets them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement, PlyElementParseError, PlyParseError

from plop.artifacts.atomic_file import whole
from plop.errors import PlopError


def write_vertices(path: str | Path, table: np.ndarray) -> None:
    """Write a binary little-endian PLY atomically.

    Args:
        path: File to write.
        table: One record per vertex, shape [N]; its fields become the properties, in their order.
    """
    with whole(Path(path)) as scratch:
        PlyData([PlyElement.describe(table, "vertex")], byte_order="<").write(str(scratch))


def read_vertices(path: str | Path) -> dict[str, np.ndarray]:
    """Read the vertex element of a PLY: binary of either byte order, or ASCII.

    Args:
        path: A PLY file whose vertices have number properties only.

    Returns:
        One array per property, shape [N], in the file's number types.

    Raises:
        PlopError: The file is missing, truncated or not such a PLY.
    """
    path = Path(path)
    if not path.is_file():
        raise PlopError("There is no such PLY file.", where=path, expected="a PLY file", found="no file")
    with path.open("rb") as file:
        if file.read(3) != b"ply":
            raise PlopError("This is not a PLY file.", where=path, expected="a file that begins with 'ply'")
    try:
        records = PlyData.read(str(path))["vertex"].data
    except (KeyError, PlyParseError, UnicodeDecodeError, ValueError, MemoryError, OverflowError) as error:
        raise _unreadable(path, error) from error
    lists = [name for name in records.dtype.names if records.dtype[name].hasobject]
    if lists:
        raise _unreadable(path, ValueError(f"the properties {', '.join(lists)} are lists"))
    return {name: np.array(records[name]) for name in records.dtype.names}


def _unreadable(path: Path, error: Exception) -> PlopError:
    """Explain why a PLY cannot be read: its header, or missing data."""
    if isinstance(error, PlyElementParseError) or "mmap length" in str(error):
        return PlopError(
            "The PLY file is truncated, or holds something that is not a number.",
            where=path,
            expected="as many vertices as the header says",
            found=str(error),
            fix="Copy or write the file again.",
        )
    return PlopError(
        "The header of this PLY cannot be parsed.",
        where=path,
        expected="a vertex element with number properties",
        found=str(error),
    )
