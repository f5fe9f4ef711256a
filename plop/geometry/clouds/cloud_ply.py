"""Write and read point clouds as PLY files (x, y, z, nx, ny, nz in metres, red, green, blue)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plop.errors import PlopError
from plop.geometry.clouds.pointcloud import PointCloud
from plop.geometry.ply import read_vertices, write_vertices

_FLOATS = ("x", "y", "z", "nx", "ny", "nz")
_COLORS = ("red", "green", "blue")


def write_cloud(path: str | Path, cloud: PointCloud) -> None:
    """Write a binary little-endian PLY atomically; positions as float32 [m]."""
    rows = np.zeros(len(cloud), dtype=[(k, "<f4") for k in _FLOATS] + [(k, "u1") for k in _COLORS])
    for i, key in enumerate("xyz"):
        rows[key] = cloud.points[:, i]
        rows["n" + key] = cloud.normals[:, i]
        rows[_COLORS[i]] = cloud.colors[:, i]
    write_vertices(path, rows)


def read_cloud(path: str | Path) -> PointCloud:
    """Read the vertices of a PLY file, ASCII or binary.

    Args:
        path: File with at least x, y, z. Missing normals become zeros, missing colours grey.

    Returns:
        The cloud, units as in the file (metres for files of plop).

    Raises:
        PlopError: The file is missing, not a PLY, truncated, lacks a coordinate, or holds NaN.
    """
    table = read_vertices(path)
    if not {"x", "y", "z"} <= table.keys():
        raise PlopError(
            "This PLY is not a point cloud.", where=path, expected="properties x, y, z", found=", ".join(table)
        )
    points = np.stack([table[name] for name in "xyz"], axis=1).astype(np.float64)
    if not np.isfinite(points).all():
        raise PlopError(
            "The point cloud has positions that are not finite.",
            where=path,
            expected="finite metres",
            found=f"{int((~np.isfinite(points)).any(1).sum())} bad points",
        )

    def columns(names: tuple[str, ...], missing: int) -> np.ndarray:
        if not set(names) <= table.keys():
            return np.full((len(points), 3), missing)
        return np.stack([table[name] for name in names], axis=1)

    return PointCloud(points, columns(_FLOATS[3:], 0).astype(np.float64), columns(_COLORS, 128).astype(np.uint8))
