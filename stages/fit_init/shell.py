"""The measured surface of the object, and the flat Gaussians that a fit starts from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.geometry.clouds.depth_planes import pixel_planes
from plop.geometry.clouds.neighbours import nearest_distance
from plop.geometry.ply import read_vertices
from plop.geometry.rigid import matrix_to_quat
from plop.geometry.view import View
from plop.render.rasterizer.sh import C0

MAX_POINTS = 40_000
"""Largest number of points of a cloud; larger clouds are subsampled evenly."""
_FACING_LEAST = 0.1
"""Cosine between surface and line of sight below which a pixel shows an edge rather than a surface."""


@dataclass(frozen=True)
class Surface:
    """Points measured on the object."""

    points: np.ndarray
    """World positions, shape [N, 3] [m]."""
    normals: np.ndarray
    """Outward unit normals, shape [N, 3]."""
    colours: np.ndarray
    """Shape [N, 3], 0..1."""

    def select(self, index: np.ndarray) -> Surface:
        """Take a subset by boolean mask or by indices."""
        return Surface(self.points[index], self.normals[index], self.colours[index])


def surface_from_cloud(path: Path) -> Surface:
    """Read a cloud with normals and colours.

    Args:
        path: PLY with x y z, nx ny nz, red green blue (0..255), in metres.

    Raises:
        PlopError: The file is broken, has no normals or colours, or no finite point.
    """
    table = read_vertices(path)
    needed = ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue"]
    missing = [name for name in needed if name not in table]
    if missing:
        raise PlopError(
            "The cloud lacks properties that the fit needs.",
            where=path,
            expected=", ".join(needed),
            found=f"no {', '.join(missing)}",
            fix="Run `plop fuse` again.",
        )
    columns = np.stack([np.asarray(table[name], dtype=np.float64) for name in needed], axis=-1)
    columns = columns[np.isfinite(columns).all(1) & (np.abs(columns[:, 3:6]).sum(1) > 0)]
    if len(columns) == 0:
        raise PlopError(
            "The cloud is empty.",
            where=path,
            expected="points with normals",
            found="none",
            fix="Check the object masks of frame 0, then run `plop fuse` again.",
        )
    normals = columns[:, 3:6] / np.linalg.norm(columns[:, 3:6], axis=1, keepdims=True)
    return _thin(Surface(columns[:, :3], normals, columns[:, 6:] / 255))


def surface_from_views(views: list[View]) -> Surface:
    """Convert depth images to a surface; normals are those of `pixel_planes`.

    Args:
        views: Measured frames of the object; those without depth add nothing.

    Raises:
        PlopError: No view has measured the object's depth.
    """
    parts = [part for part in (_surface_of_view(view) for view in views) if len(part.points)]
    if not parts:
        raise PlopError(
            "No camera measured the depth of the object at frame 0.",
            where=", ".join(view.camera.name for view in views),
            expected="depth inside the object's mask",
            found="none",
            fix="Use a cloud from `plop fuse`, or check depth and masks.",
        )
    stacked = (np.concatenate([getattr(part, name) for part in parts]) for name in ("points", "normals", "colours"))
    return _thin(Surface(*stacked))


def _surface_of_view(view: View) -> Surface:
    planes = pixel_planes(view.camera, view.depth_m, view.object_mask)
    keep = planes.facing > _FACING_LEAST
    return Surface(view.camera.back_project(view.depth_m, keep), planes.normals[keep], view.rgb[keep] / 255)


def _thin(surface: Surface) -> Surface:
    step = -(-len(surface.points) // MAX_POINTS)
    return surface.select(np.arange(0, len(surface.points), step))


def seen_by(points: np.ndarray, views: list[View], tolerance_m: float) -> np.ndarray:
    """Return which points at least one view has measured.

    Args:
        points: Shape [N, 3], world, metres.
        views: Measured frames; without depth, all points in the mask count as measured.
        tolerance_m: Largest difference in depth between a point and the pixel it falls on [m].

    Returns:
        bool, shape [N].
    """
    seen = np.zeros(len(points), dtype=bool)
    for view in views:
        inside, row, column, depth = view.camera.pixels_of(points)
        measured = view.depth_m[row, column]
        near = (np.abs(measured - depth) < tolerance_m) | ~(view.depth_m > 0).any()
        seen |= inside & view.object_mask[row, column] & near
    return seen


def carved(points: np.ndarray, views: list[View], tolerance_m: float) -> np.ndarray:
    """Return which points cannot be inside the object, because a view sees past or through them.

    Args:
        points: Shape [N, 3], world, metres.
        views: Measured frames.
        tolerance_m: Largest distance of a point in front of the measured surface [m].

    Returns:
        bool, shape [N].
    """
    outside = np.zeros(len(points), dtype=bool)
    for view in views:
        inside, row, column, depth = view.camera.pixels_of(points)
        measured = view.depth_m[row, column]
        before = view.object_mask[row, column] & (measured > 0) & (depth < measured - tolerance_m)
        outside |= inside & (before | (view.mask[row, column] == 0))
    return outside


def seed_gaussians(surface: Surface, count: int, *, opacity: float, overlap: float, flatness: float) -> Gaussians:
    """Place flat Gaussians evenly on a surface.

    Args:
        surface: N >= 1 points.
        count: Number of Gaussians, fewer where the surface has fewer points.
        opacity: Peak opacity.
        overlap: Standard deviation along the surface as a share of the local spacing.
        flatness: That standard deviation over the one along the normal.

    Returns:
        Gaussians with sh of degree 0; ids count from 0.
    """
    chosen = surface.select(farthest_points(surface.points, count))
    means = torch.from_numpy(chosen.points).float()
    gaps = nearest_distance(means)
    spacing = float(gaps.median()) if len(means) > 1 else 1e-3
    along = overlap * gaps.clamp(0.5 * spacing, 1.5 * spacing)
    colours = torch.from_numpy(chosen.colours).float()
    return Gaussians(
        means=means,
        quats=quats_along(torch.from_numpy(chosen.normals).float()),
        scales=torch.stack([along, along, along / flatness], dim=-1),
        opacities=torch.full((len(means),), opacity),
        sh=((colours - 0.5) / C0)[:, None],
        ids=torch.arange(len(means)),
    )


def quats_along(normals: torch.Tensor) -> torch.Tensor:
    """Return rotations whose third axis is the normal, unit [N, 3] -> wxyz [N, 4]."""
    helper = torch.where(normals[:, :1].abs() < 0.9, normals.new_tensor([1.0, 0, 0]), normals.new_tensor([0, 1.0, 0]))
    first = torch.nn.functional.normalize(torch.linalg.cross(helper, normals), dim=-1)
    second = torch.linalg.cross(normals, first)
    return matrix_to_quat(torch.stack([first, second, normals], dim=-1))


def farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """Choose points far from each other (farthest-point sampling), starting with the first.

    Args:
        points: Shape [N, 3].
        count: Number of points; all when N is smaller.

    Returns:
        Indices, shape [min(N, count)], int64.
    """
    count = min(count, len(points))
    columns = np.ascontiguousarray(points.T.astype(np.float32))
    chosen = np.zeros(count, dtype=np.int64)
    distance = np.full(len(points), np.inf, dtype=np.float32)
    for index in range(1, count):
        offset = columns - columns[:, chosen[index - 1], None]
        np.minimum(distance, np.einsum("ij,ij->j", offset, offset), out=distance)
        chosen[index] = int(distance.argmax())
    return chosen
