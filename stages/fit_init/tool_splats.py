"""The tool as Gaussians in its own frame: spread evenly over its mesh, coloured by the images.

Later frames of a test episode are not used for colours, because rollouts are scored on them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from plop.gaussians.state import Gaussians
from plop.geometry.clouds.neighbours import nearest_distance, nearest_index
from plop.geometry.meshes.tool import ToolGeometry
from plop.geometry.rigid import transform_points
from plop.recordings.recording import Mesh, Recording
from plop.render.rasterizer.sh import C0
from stages.fit_init.shell import farthest_points, quats_along

_DEPTH_TOLERANCE_M = 0.003
_FLATNESS = 5.0
_OVERLAP = 0.5
_DRAWN_IN = 0.4
"""Inward shift of the outline, as a share of the distance between Gaussians, which extend beyond their centres."""
_SINGLE_GAP_M = 1e-3
_ROUNDS = 5
_FRAMES = 6
_SAME_M = 1e-6
"""Vertices closer than this are the same [m]."""


@dataclass(frozen=True)
class ToolViews:
    """Number of images for the tool's colour."""

    recording: Recording
    cameras: list[str]
    frames: list[int]


def spread_over(recording: Recording, cameras: list[str]) -> ToolViews:
    """Read frames spread over a training episode: a moving tool shows more of its sides."""
    frames = np.unique(np.linspace(0, len(recording) - 1, _FRAMES).astype(int))
    return ToolViews(recording, cameras, frames.tolist())


def same_tool(one: Mesh, two: Mesh) -> bool:
    """Return whether two recordings have the same mesh as their tool."""
    return (
        one.vertices.shape == two.vertices.shape
        and np.array_equal(one.faces, two.faces)
        and np.allclose(one.vertices, two.vertices, atol=_SAME_M)
    )


def tool_gaussians(mesh: Mesh, views: Sequence[ToolViews], count: int, seed: int) -> tuple[Gaussians, float]:
    """Sample the tool's surface and colour it from the pixels that show it.

    Args:
        mesh: The tool.
        views: Images for the colours; none may be a later frame of a test episode.
        count: Number of Gaussians.
        seed: Seed of the sampling.

    Returns:
        Gaussians in the tool's frame, opacity 0.99, and the visible share of them. The others
        have the colour of the nearest visible one; all are grey when none is visible.
    """
    points, normals = sample_mesh(drawn_in(mesh, count), count, seed)
    colours, seen = _colours(views, points)
    if seen.any():
        means, donors = torch.from_numpy(points), torch.from_numpy(np.flatnonzero(seen))
        colours = colours[donors[nearest_index(means, means[donors])].numpy()]
    return splats_on(points, normals, colours), float(seen.mean())


def splats_on(points: np.ndarray, normals: np.ndarray, colours: np.ndarray) -> Gaussians:
    """Return flat, opaque Gaussians that cover a surface.

    Args:
        points: Spread evenly over it, [N, 3] [m].
        normals: Unit normals, [N, 3].
        colours: 0 to 1, [N, 3].
    """
    along = _OVERLAP * _gaps(points, normals)
    return Gaussians(
        means=torch.from_numpy(points).float(),
        quats=quats_along(torch.from_numpy(normals).float()),
        scales=torch.stack([along, along, along / _FLATNESS], dim=-1),
        opacities=torch.full((len(points),), 0.99),
        sh=((torch.from_numpy(colours).float() - 0.5) / C0)[:, None],
        ids=torch.arange(len(points)),
    )


def drawn_in(mesh: Mesh, count: int) -> Mesh:
    """Shrink a tool along its principal axes, so that Gaussians on its surface render at its true size.

    Args:
        mesh: The tool.
        count: Number of Gaussians that will represent it; the more, the smaller they are.

    Returns:
        The mesh, smaller along every axis on which at least a few of them lie side by side.
    """
    tool = ToolGeometry.from_mesh(mesh.vertices, mesh.faces)
    axes, center, half = (part.double().numpy() for part in (tool.axes, tool.center, tool.half_extent))
    apart = np.sqrt(_faces(mesh)[1].sum() / count)
    share = np.where(half > 2 * apart, 1 - _DRAWN_IN * apart / half, 1.0)
    local = (mesh.vertices - center) @ axes
    return Mesh((local * share) @ axes.T + center, mesh.faces)


def sample_mesh(mesh: Mesh, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Spread points evenly over a mesh.

    Args:
        mesh: Triangles with some area.
        count: Number of points.
        seed: Seed of the random candidates.

    Returns:
        Points [count, 3] in the mesh's unit and unit normals [count, 3].
    """
    corners, area, across = _faces(mesh)
    random = np.random.default_rng(seed)
    face = random.choice(len(area), size=8 * count, p=area / area.sum())
    u, v = random.random((2, 8 * count))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    a, b, c = corners[face].transpose(1, 0, 2)
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    normals = across[face]
    return _centred(points, normals, farthest_points(_sides_apart(points, normals), count))


def _faces(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners [F, 3, 3] [m], areas [F] [m2] and unit normals [F, 3] of a mesh's triangles."""
    corners = mesh.vertices[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(cross, axis=1)
    return corners, twice / 2, cross / np.maximum(twice, 1e-30)[:, None]


def _centred(points: np.ndarray, normals: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Move chosen points to the middle of the parts of the surface that they represent (Lloyd's relaxation).

    Points on the outline, as chosen by farthest-point sampling, would render the tool wider than it is.
    """
    sides = _sides_apart(points, normals)
    centres = sides[chosen]
    for _ in range(_ROUNDS):
        owner = cKDTree(centres).query(sides)[1]
        sums = np.stack([np.bincount(owner, column, len(centres)) for column in sides.T], axis=1)
        owned = np.bincount(owner, minlength=len(centres))[:, None]
        centres = np.where(owned > 0, sums / np.maximum(owned, 1), centres)
    return centres[:, :3], normals[cKDTree(sides).query(centres)[1]]


def _gaps(points: np.ndarray, normals: np.ndarray) -> torch.Tensor:
    """Measure the distance to the nearest point on the same side, [N] m, within 0.5 and 1.5 times the median.

    The other side of a thin blade is not a neighbour: Gaussians as small as the thickness of the edge would leave
    holes.
    """
    if len(points) == 1:
        return torch.tensor([_SINGLE_GAP_M])
    gaps = nearest_distance(torch.from_numpy(_sides_apart(points, normals))).float()
    return gaps.clamp(0.5 * gaps.median(), 1.5 * gaps.median())


def _sides_apart(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Separate the two sides of a thin blade by its length, so that neighbours are on the same side, [N, 6]."""
    return np.concatenate([points, np.ptp(points, axis=0).max() * normals], axis=1)


def _colours(views: Sequence[ToolViews], points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average the pixels that show each point; grey where there are none. [N, 3] and bool [N]."""
    total, hits = np.zeros((len(points), 3)), np.zeros(len(points))
    for source in views:
        poses = source.recording.world_from_tool
        for frame in source.frames:
            world = transform_points(poses[frame], points)
            for name in source.cameras:
                view = source.recording.view(name, frame)
                inside, row, column, depth = view.camera.pixels_of(world)
                measured = view.depth_m[row, column]
                shown = inside & view.tool_mask[row, column] & (np.abs(measured - depth) < _DEPTH_TOLERANCE_M)
                total[shown] += view.rgb[row[shown], column[shown]] / 255
                hits += shown
    seen = hits > 0
    return np.where(seen[:, None], total / np.maximum(hits, 1)[:, None], 0.5), seen
