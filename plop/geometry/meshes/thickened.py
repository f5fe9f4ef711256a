"""A mesh whose surface lies farther out, or in, by one distance everywhere."""

from __future__ import annotations

import numpy as np

from plop.geometry.meshes.mesh_topology import welded

_ALIKE = 1e-3
"""A corner is not moved in directions that its faces span less than this (singular value over the largest): neighbours
on a plane or a fine mesh differ by rounding."""


def thickened(vertices: np.ndarray, faces: np.ndarray, distance_m: float) -> np.ndarray:
    """Move every face along its normal by one distance: an edge stays sharp, a plane stays plane.

    Each corner goes where it is `distance_m` in front of all its faces (least squares, least motion), as offsets of
    polyhedra are defined; a box grows by the distance on each side.

    Args:
        vertices: Shape [V, 3] [m].
        faces: Shape [F, 3]; corners at the same place move together.
        distance_m: Outwards where positive.

    Returns:
        Shape [V, 3] [m].
    """
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    _, place = np.unique(welded(vertices, np.arange(len(vertices))), return_inverse=True)
    squares, sums = np.zeros((len(vertices), 3, 3)), np.zeros((len(vertices), 3))
    for corner in place[faces].T:  # normal equations of each corner
        np.add.at(squares, corner, normals[:, :, None] * normals[:, None])
        np.add.at(sums, corner, normals)
    steps = np.einsum("vij,vj->vi", np.linalg.pinv(squares, rcond=_ALIKE**2, hermitian=True), distance_m * sums)
    return np.asarray(vertices + steps[place])
