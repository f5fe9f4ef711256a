"""Write and read point clouds as PLY files (x, y, z, nx, ny, nz in metres, red, green, blue)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plop.artifacts.atomic_file import whole
from plop.errors import PlopError
from plop.geometry.clouds.pointcloud import PointCloud

_KINDS = {
    "float": "<f4",
    "float32": "<f4",
    "double": "<f8",
    "float64": "<f8",
    "uchar": "u1",
    "uint8": "u1",
    "char": "i1",
    "int8": "i1",
    "short": "<i2",
    "ushort": "<u2",
    "int": "<i4",
    "int32": "<i4",
    "uint": "<u4",
    "uint32": "<u4",
}
_FLOATS = ("x", "y", "z", "nx", "ny", "nz")
_COLORS = ("red", "green", "blue")


def write_cloud(path: str | Path, cloud: PointCloud) -> None:
    """Write a binary little-endian PLY, whole or not at all; positions as float32 [m]."""
    path = Path(path)
    rows = np.zeros(len(cloud), dtype=[(k, "<f4") for k in _FLOATS] + [(k, "u1") for k in _COLORS])
    for i, key in enumerate("xyz"):
        rows[key] = cloud.points[:, i]
        rows["n" + key] = cloud.normals[:, i]
        rows[_COLORS[i]] = cloud.colors[:, i]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    head += [f"property float {key}" for key in _FLOATS] + [f"property uchar {key}" for key in _COLORS]
    with whole(path) as scratch:
        scratch.write_bytes(("\n".join([*head, "end_header"]) + "\n").encode() + rows.tobytes())


def read_cloud(path: str | Path) -> PointCloud:
    """Read the vertices of a PLY file, ASCII or binary little-endian.

    Args:
        path: File with at least x, y, z. Missing normals become zeros, missing colours grey.

    Returns:
        The cloud, units as in the file (metres for files of plop).

    Raises:
        PlopError: The file is missing, no PLY, truncated, or holds NaN.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise PlopError(
            "The point cloud cannot be read.",
            where=path,
            expected="a PLY file",
            found=str(error),
            fix="Run `plop fuse` first, or correct the path.",
        ) from error
    try:
        rows = _rows(raw)
        points = np.stack([rows[k] for k in "xyz"], axis=1).astype(np.float64)
    except (ValueError, KeyError, IndexError, UnicodeDecodeError) as error:
        raise PlopError(
            "This is not a point cloud that can be read.",
            where=path,
            found=str(error),
            expected="a PLY file, ascii or binary_little_endian, with x, y, z",
        ) from error
    if not np.isfinite(points).all():
        raise PlopError(
            "The point cloud has positions that are no numbers.",
            where=path,
            expected="finite metres",
            found=f"{int((~np.isfinite(points)).any(1).sum())} bad points",
        )
    names = rows.dtype.names or ()
    normals = np.stack([rows[k] for k in _FLOATS[3:]], 1).astype(np.float64) if "nx" in names else 0 * points
    colors = np.stack([rows[k] for k in _COLORS], 1).astype(np.uint8) if "red" in names else np.full_like(points, 128)
    return PointCloud(points, normals, colors.astype(np.uint8))


def _rows(raw: bytes) -> np.ndarray:
    end = raw.index(b"end_header")
    body = raw.index(b"\n", end) + 1
    lines = [line.split() for line in raw[:end].decode("ascii").splitlines()]
    if lines[0] != ["ply"]:
        raise ValueError("no PLY header")
    style = next(line[1] for line in lines if line[:1] == ["format"])
    elements = [i for i, line in enumerate(lines) if line[:1] == ["element"]]
    if not elements or lines[elements[0]][1] != "vertex":
        raise ValueError("the first element is not 'vertex'")
    count = int(lines[elements[0]][2])
    last = elements[1] if len(elements) > 1 else len(lines)
    kind = np.dtype([(line[2], _KINDS[line[1]]) for line in lines[elements[0] : last] if line[0] == "property"])
    if style == "binary_little_endian":
        if len(raw) - body < count * kind.itemsize:
            raise ValueError("the file is truncated")
        return np.frombuffer(raw, kind, count, body)
    if style != "ascii":
        raise ValueError(f"format {style}")
    table = np.array([line.split() for line in raw[body:].decode("ascii").splitlines()[:count]], dtype=np.float64)
    return np.rec.fromarrays(list(table.T), dtype=kind)
