"""The tool as a rigid body: its mesh, its distance field and, for a blade, its mid-surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import ConvexHull
from torch import Tensor
from trimesh import Trimesh
from trimesh.repair import fix_normals

from plop.geometry.meshes.convex import sides_of


@dataclass(frozen=True)
class ToolGeometry:
    """A rigid tool described in its own frame."""

    vertices: Tensor
    """Mesh vertices, shape [V, 3] [m]."""
    faces: Tensor
    """Triangles, shape [F, 3], int64."""
    center: Tensor
    """Middle of the bounding box along the principal axes, shape [3] [m]."""
    axes: Tensor
    """Principal axes as columns, shortest extent first, shape [3, 3]; column 0 is a blade's normal."""
    half_extent: Tensor
    """Half the extent along each axis, ascending, shape [3] [m]."""
    outline: Tensor
    """Convex outline of the tool seen along column 0, counter-clockwise in (axes 1, 2), shape [K, 2] [m]."""
    hull: Tensor
    """Planes of the convex hull in the tool's frame, outward normal and offset: n x <= d inside, shape [P, 4]."""
    filled: float
    """Share of its convex hull that the mesh fills, 0 for a mesh that is not closed [-]."""

    @classmethod
    def from_mesh(cls, vertices: np.ndarray, faces: np.ndarray) -> ToolGeometry:
        """Measure a mesh: principal axes from its convex hull, outline from its projection.

        Args:
            vertices: Shape [V, 3], metres.
            faces: Shape [F, 3].
        """
        vertices = np.asarray(vertices, dtype=np.float64)
        convex = ConvexHull(vertices)
        hull = vertices[convex.vertices]
        _, _, rows = np.linalg.svd(hull - hull.mean(0), full_matrices=False)
        spans = np.ptp(hull @ rows.T, axis=0)
        axes = rows[np.argsort(spans)].T
        if np.linalg.det(axes) < 0:
            axes[:, 2] *= -1
        local = vertices @ axes
        low, high = local.min(0), local.max(0)
        flat = (local - (low + high) / 2)[:, 1:]
        outline = flat[ConvexHull(flat).vertices]
        tensors = (vertices, axes @ ((low + high) / 2), axes, (high - low) / 2, outline, sides_of(convex))
        vert, center, axis, half, line, sides = (torch.as_tensor(x, dtype=torch.float32) for x in tensors)
        faces = np.asarray(faces)
        return cls(
            vert,
            torch.as_tensor(faces, dtype=torch.int64),
            center,
            axis,
            half,
            line,
            sides,
            _closed_volume(vertices, faces) / convex.volume,
        )

    def beside_blade(self, points_tool: Tensor) -> tuple[Tensor, Tensor]:
        """Locate points of the tool's frame relative to a blade.

        Args:
            points_tool: Shape [N, 3] [m].

        Returns:
            Signed distance to the blade's mid-plane [N] [m], and how far a point lies beyond the outline, negative
            inside [N] [m].
        """
        corners = self.outline.to(points_tool)
        edge = corners.roll(-1, 0) - corners
        outward = torch.stack([edge[:, 1], -edge[:, 0]], -1) / edge.norm(dim=-1, keepdim=True)
        axes, center = self.axes.to(points_tool), self.center.to(points_tool)
        # the mid-plane and the outline's edges in one product: products with few and with many columns cost the same
        planes = torch.cat([axes[:, :1], axes[:, 1:] @ outward.T], dim=1)
        shift = torch.cat([corners.new_zeros(1), (corners * outward).sum(-1)])
        distance = torch.addmm(-(center @ planes + shift), points_tool, planes)
        return distance[:, 0], distance[:, 1:].amax(-1)

    def depth_inside(self, points_tool: Tensor) -> Tensor:
        """Return how deep points of the tool's frame lie in its convex hull, 0 outside.

        Args:
            points_tool: Shape [N, 3] [m].

        Returns:
            Distance to the nearest face, shape [N] [m].
        """
        planes = self.hull.to(points_tool)
        return torch.addmm(-planes[:, 3], points_tool, planes[:, :3].T).amax(-1).neg().clamp_min(0)

    def surface_points(self, count: int) -> Tensor:
        """Spread points over the surface by area, deterministically.

        Args:
            count: Number of points.

        Returns:
            Points in the tool's frame, shape [count, 3] [m].
        """
        corners = self.vertices[self.faces]
        area = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=-1)
        place = (torch.arange(count, device=self.vertices.device) + 0.5) / count
        face = torch.searchsorted((area.cumsum(0) / area.sum()).contiguous(), place.to(area)).clamp_max(len(area) - 1)
        # Two irrational steps give an even, repeatable spread inside the triangles (R2 sequence).
        step = torch.arange(count, dtype=torch.float64, device=self.vertices.device)
        u, v = (0.5 + 0.7548776662466927 * step) % 1, (0.5 + 0.5698402909980532 * step) % 1
        root = u.sqrt()
        weights = torch.stack([1 - root, root * (1 - v), root * v], dim=-1).to(corners)
        return (corners[face] * weights[..., None]).sum(1)

    def to(self, device: torch.device | str) -> ToolGeometry:
        """Copy on another device."""
        moved = {name: value.to(device) for name, value in vars(self).items() if isinstance(value, Tensor)}
        return ToolGeometry(filled=self.filled, **moved)


def _closed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume inside a mesh of one or more bodies, for any orientation of its faces [m^3]; 0 if it is not closed."""
    mesh = Trimesh(vertices, faces, process=True)
    if not mesh.is_watertight:
        return 0.0
    fix_normals(mesh, multibody=True)
    return float(abs(mesh.volume))
