"""Fill the inside of a shell of Gaussians: a cut exposes it, and dynamics need its mass.

An opacity grid around the Gaussians separates shell and empty space. `paper` places one Gaussian
wherever a ray along one of the six axes passes from low to high opacity (PLOP, Sec. III-C, after
PhysGaussian). `solid` finds the empty cells that are enclosed on all six axes and fills them evenly.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from plop.gaussians.state import Gaussians
from plop.geometry.clouds.neighbours import nearest_index
from plop.geometry.rigid import quat_to_matrix

_SAMPLES = 5
"""Sampling points along each axis of a Gaussian, from -2 to 2 standard deviations."""
_SMALLEST_SHARE = 0.35
"""Largest standard deviation of an inner Gaussian, as a share of its distance to the nearest other one."""


@dataclass(frozen=True)
class OpacityGrid:
    """Opacity on a regular grid around a set of Gaussians, with a rim of one empty cell."""

    opacity: Tensor
    """Highest opacity that a Gaussian has in each cell, shape [X, Y, Z]."""
    origin: Tensor
    """Corner of cell (0, 0, 0), shape [3] [m]."""
    cell_m: float

    @classmethod
    def around(cls, gaussians: Gaussians, cells: int, *, floor_z_m: float | None = None) -> OpacityGrid:
        """Measure the opacity of Gaussians on cubes.

        Args:
            gaussians: N >= 1 Gaussians.
            cells: Number of cells along the longest side of the bounding box.
            floor_z_m: Height of a table, down to which the grid extends [m].
        """
        means = gaussians.means.detach()
        low, high = means.amin(0), means.amax(0)
        if floor_z_m is not None:
            low = torch.cat([low[:2], low[2:].clamp_max(floor_z_m)])
        cell = float((high - low).amax().clamp_min(1e-6)) / cells
        size = ((high - low) / cell).ceil().long() + 3
        origin = low - 1.5 * cell
        points, values = _samples(gaussians.detach())
        index = ((points - origin) / cell).long().clamp_min(0).minimum(size - 1)
        flat = (index[:, 0] * size[1] + index[:, 1]) * size[2] + index[:, 2]
        opacity = means.new_zeros(int(size.prod())).scatter_reduce(0, flat, values, "amax")
        return cls(opacity.reshape(*size.tolist()), origin, cell)

    def centers(self, cells: Tensor) -> Tensor:
        """Return the middles of cells, [M, 3] int64 -> [M, 3] m."""
        return self.origin + (cells + 0.5) * self.cell_m

    def enclosed(self, threshold: float, *, floor_z_m: float | None = None) -> Tensor:
        """Find the cells of low opacity that meet high opacity in all six directions.

        Args:
            threshold: Smallest high opacity.
            floor_z_m: A table below which nothing is empty: it closes the grid downwards [m].

        Returns:
            bool, shape [X, Y, Z].
        """
        solid = self.opacity > threshold
        closed = ~solid
        for axis in range(3):
            closed &= _seen_before(solid, axis)
            above = _seen_before(solid.flip(axis), axis).flip(axis)
            closed &= above
        if floor_z_m is None:
            return closed
        # A table closes the bottom, which no camera sees; cells under it are not part of the object.
        height = self.origin[2] + (torch.arange(solid.shape[2], device=solid.device) + 1) * self.cell_m
        over = ~solid & _seen_before(solid.flip(2), 2).flip(2) & (height > floor_z_m)
        for axis in range(2):
            over &= _seen_before(solid, axis) & _seen_before(solid.flip(axis), axis).flip(axis)
        return closed | over


def _samples(gaussians: Gaussians) -> tuple[Tensor, Tensor]:
    """Sample every Gaussian out to two standard deviations; points [N S, 3] and their opacity [N S]."""
    line = torch.linspace(-2.0, 2.0, _SAMPLES, device=gaussians.means.device, dtype=gaussians.means.dtype)
    unit = torch.cartesian_prod(line, line, line)
    unit = unit[unit.norm(dim=1) < 2.1]
    spread = quat_to_matrix(gaussians.quats) * gaussians.scales[:, None, :]
    points = gaussians.means[:, None] + torch.einsum("nij,sj->nsi", spread, unit)
    values = gaussians.opacities[:, None] * torch.exp(-0.5 * unit.square().sum(1))
    return points.reshape(-1, 3), values.reshape(-1)


def _seen_before(solid: Tensor, axis: int) -> Tensor:
    """Return for every cell whether a solid one lies at a lower index along an axis."""
    return (solid.cumsum(axis) - solid.long()) > 0


def fill_paper(gaussians: Gaussians, *, cells: int = 16, threshold: float = 0.1) -> Gaussians:
    """Place one Gaussian at each low-to-high transition of the opacity along six axes.

    Args:
        gaussians: The shell, N >= 1 Gaussians.
        cells: Cells along the longest side.
        threshold: Opacity between low and high.

    Returns:
        The new Gaussians alone, in the middles of the high cells, all other properties copied from
        the nearest existing Gaussian, including ids.

    Source: PLOP, Sec. III-C.
    """
    grid = OpacityGrid.around(gaussians, cells)
    high = grid.opacity > threshold
    entered = torch.zeros_like(high)
    for axis in range(3):
        before = torch.roll(high, 1, axis)
        after = torch.roll(high, -1, axis)
        entered |= high & (~before | ~after)  # the rim of the grid is empty, so the roll wraps empty cells
    points = grid.centers(torch.nonzero(entered))
    return gaussians.select(nearest_index(points, gaussians.means)).with_(means=points)


def solid_points(
    gaussians: Gaussians,
    spacing_m: float,
    *,
    cells: int = 32,
    threshold: float = 0.1,
    floor_z_m: float | None = None,
    jitter: float = 0.15,
    generator: torch.Generator | None = None,
) -> Tensor:
    """Spread points evenly over the space that a shell encloses.

    Points lie on a body-centred cubic lattice, displaced randomly by a fraction of the spacing.

    Args:
        gaussians: The shell, N >= 1 Gaussians.
        spacing_m: Cube root of the volume that one point stands for [m].
        cells: Cells of the opacity grid along the longest side.
        threshold: Opacity between low and high.
        floor_z_m: A table, which closes the shell at the bottom [m].
        jitter: Standard deviation of the random displacement, as a share of the spacing.
        generator: Draws the displacements.

    Returns:
        Points, shape [M, 3], m; none where nothing is enclosed.
    """
    grid = OpacityGrid.around(gaussians, cells, floor_z_m=floor_z_m)
    inside = grid.enclosed(threshold, floor_z_m=floor_z_m)
    edge = spacing_m * 2 ** (1 / 3)
    counts = [max(int(size * grid.cell_m / edge) + 1, 1) for size in inside.shape]
    corner = torch.cartesian_prod(*(torch.arange(n, device=grid.origin.device) for n in counts)) * edge
    points = torch.cat([corner, corner + edge / 2]) + grid.origin
    if floor_z_m is not None:
        shift = (points[:, 2].min() - floor_z_m - 0.35 * spacing_m) % (edge / 2)
        points = points - torch.stack([shift * 0, shift * 0, shift])
    noise = torch.randn(points.shape, generator=generator) * (jitter * spacing_m)
    points = points + noise.to(points)
    index = ((points - grid.origin) / grid.cell_m).floor().long()
    within = ((index >= 0) & (index < torch.tensor(inside.shape, device=index.device))).all(1)
    if floor_z_m is not None:
        within &= points[:, 2] > floor_z_m + 0.15 * spacing_m
    points, index = points[within], index[within]
    return points[inside[index[:, 0], index[:, 1], index[:, 2]]]


def inner_gaussians(points: Tensor, shell: Gaussians, spacing_m: float, *, opacity: float, overlap: float) -> Gaussians:
    """Make round Gaussians at inner points, coloured like the nearest of the shell.

    Args:
        points: Shape [M, 3], m.
        shell: The Gaussians around them, N >= 1.
        spacing_m: Spacing of the points [m].
        opacity: Peak opacity of each.
        overlap: Standard deviation as a share of the spacing; smaller where the shell is near.

    Returns:
        M Gaussians; ids are those of the nearest in the shell.
    """
    nearest = nearest_index(points, shell.means)
    gap = (points - shell.means[nearest]).norm(dim=1)
    sigma = (overlap * spacing_m * torch.ones_like(gap)).minimum(_SMALLEST_SHARE * gap)
    return Gaussians(
        means=points,
        quats=points.new_tensor([1.0, 0.0, 0.0, 0.0]).expand(len(points), 4).clone(),
        scales=sigma[:, None].expand(-1, 3).clone(),
        opacities=points.new_full((len(points),), opacity),
        sh=shell.sh[nearest].clone(),
        ids=shell.ids[nearest].clone(),
    )
