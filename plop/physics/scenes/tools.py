"""Rigid tools as closed meshes in their own frame: origin in the middle of the lower end, z up."""

from __future__ import annotations

import numpy as np

from plop.physics.scenes.lattice import lattice

Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices [V, 3] [m] and outward triangles [F, 3]."""


def blade_mesh(height_m: float = 0.040, length_m: float = 0.150, edge_m: float = 8e-5, spine_m: float = 0.002) -> Mesh:
    """Build a straight blade: edge at z = 0, spine above, normal x, length along y."""
    grid = lattice((1, 1, 1))
    u, v, w = grid.parameters.T
    vertices = np.stack([(u - 0.5) * (edge_m + w * (spine_m - edge_m)), (v - 0.5) * length_m, w * height_m], 1)
    return vertices, grid.faces


def box_mesh(size_m: tuple[float, float, float]) -> Mesh:
    """Build a box that stands on z = 0."""
    grid = lattice((1, 1, 1))
    return (grid.parameters - [0.5, 0.5, 0]) * size_m, grid.faces


def cylinder_mesh(radius_m: float, height_m: float, corners: int = 24) -> Mesh:
    """Build an upright cylinder that stands on z = 0, as a prism over a regular polygon."""
    angle = 2 * np.pi * np.arange(corners) / corners
    ring = radius_m * np.stack([np.cos(angle), np.sin(angle)], 1)
    vertices = np.concatenate(
        [np.c_[ring, np.zeros(corners)], np.c_[ring, np.full(corners, height_m)], [[0, 0, 0], [0, 0, height_m]]]
    )
    low = np.arange(corners)
    following = np.roll(low, -1)
    bottom, top = np.full(corners, 2 * corners), np.full(corners, 2 * corners + 1)
    faces = np.concatenate(
        [
            np.stack([low, following, following + corners], 1),
            np.stack([low, following + corners, low + corners], 1),
            np.stack([bottom, following, low], 1),
            np.stack([top, low + corners, following + corners], 1),
        ]
    )
    return vertices, faces
