"""Particles on a lattice whose outer nodes are the vertices of a watertight surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Lattice:
    """A box of nodes in parameters (u, v, w) in [0, 1], nodes on the boundary included."""

    parameters: np.ndarray
    """[N, 3] [-], w fastest."""
    weights: np.ndarray
    """Share of the volume of a box that each node stands for, [N]; sums to 1."""
    faces: np.ndarray
    """Triangles of the surface, [F, 3], indices into the nodes, outward for a right-handed map."""
    face_of: np.ndarray
    """Which of the six sides a triangle lies on, [F]: 0 u=0, 1 u=1, 2 v=0, 3 v=1, 4 w=0, 5 w=1."""


def lattice(counts: tuple[int, int, int]) -> Lattice:
    """Build a lattice with the given number of cells along each axis (each at least 1)."""
    axes = [np.linspace(0, 1, n + 1) for n in counts]
    parameters = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    shares = [np.r_[0.5, np.ones(n - 1), 0.5] / n for n in counts]
    weights = np.einsum("i,j,k->ijk", *shares).ravel()
    index = np.arange(len(parameters)).reshape([n + 1 for n in counts])
    triangles, sides = [], []
    for axis in range(3):
        for end in range(2):
            sheet = np.take(index, -end, axis=axis)
            # removing axis 1 from (u, v, w) leaves a left-handed pair, removing another one a right-handed pair
            if (axis == 1) != (end == 1):
                sheet = sheet.T
            a, b, c, d = sheet[:-1, :-1].ravel(), sheet[1:, :-1].ravel(), sheet[1:, 1:].ravel(), sheet[:-1, 1:].ravel()
            quads = np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])
            triangles.append(quads)
            sides.append(np.full(len(quads), 2 * axis + end))
    return Lattice(parameters, weights, np.concatenate(triangles), np.concatenate(sides))


def surface_vertices(lattice_faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number the nodes that a surface uses from 0.

    Returns:
        Indices of the surface's nodes [V], sorted, and the faces [F, 3] in the new numbers.
    """
    used, faces = np.unique(lattice_faces, return_inverse=True)
    return used, faces.reshape(lattice_faces.shape)
