"""The inner Gaussians of a fit: their positions and number."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from plop.gaussians.filling import fill_paper, inner_gaussians, solid_points
from plop.gaussians.state import Gaussians
from plop.geometry.clouds.neighbours import nearest_distance, nearest_index
from plop.geometry.view import View
from stages.fit_init.shell import carved

_LEAST_GAP = 0.45
"""Smallest distance of inner Gaussians from the shell, as a share of their spacing."""


def solid_filler(
    views: list[View], count: int, *, cells: int, floor_z_m: float | None, opacity: float, overlap: float, seed: int
) -> Callable[[Gaussians], Gaussians]:
    """Return a function that fills a shell evenly with `count` Gaussians, or slightly fewer.

    Points that a view sees through or past are left out: silhouettes and depths carve details that the
    opacity grid does not resolve.

    Args:
        views: Measured frames for carving.
        count: Number of inner Gaussians.
        cells: Cells of the opacity grid along the longest side.
        floor_z_m: The table, which closes the shell at the bottom [m].
        opacity: Peak opacity of the inner Gaussians.
        overlap: Their standard deviation as a share of their spacing.
        seed: Seed of the random displacement of the points.
    """

    def points_at(shell: Gaussians, spacing_m: float) -> Tensor:
        generator = torch.Generator().manual_seed(seed)
        points = solid_points(shell, spacing_m, cells=cells, floor_z_m=floor_z_m, generator=generator)
        if len(points) == 0:
            return points
        gap = (points - shell.means[nearest_index(points, shell.means)]).norm(dim=1)
        outside = carved(points.double().numpy(), views, 0.5 * spacing_m)
        return points[(gap > _LEAST_GAP * spacing_m) & ~torch.from_numpy(outside)]

    def fill(shell: Gaussians) -> Gaussians:
        extent = shell.means.amax(0) - shell.means.amin(0)
        spacing_m = float(extent.prod().clamp_min(1e-12) / max(count, 1)) ** (1 / 3)
        points = points_at(shell, spacing_m)
        for _ in range(6):
            if len(points) == 0 or 0.95 * count <= len(points) <= count:
                break
            spacing_m *= (len(points) / (0.98 * count)) ** (1 / 3)
            points = points_at(shell, spacing_m)
        return inner_gaussians(points[:count], shell, spacing_m, opacity=opacity, overlap=overlap)

    return fill


def paper_filler(cells: int, floor_z_m: float | None) -> Callable[[Gaussians], Gaussians]:
    """Return a function that fills as in the paper; `floor_z_m` only discards points under a table [m]."""

    def fill(shell: Gaussians) -> Gaussians:
        filled = fill_paper(shell, cells=cells)
        return filled if floor_z_m is None else filled.select(filled.means[:, 2] > floor_z_m)

    return fill


def typical_spacing(points: Tensor) -> float:
    """Measure the median distance between neighbours, shape [N, 3] with N >= 2 [m]."""
    return float(nearest_distance(points).median())
