"""Which particles lie on the surface of a body, and where it faces."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

_NEIGHBOURS = 1.9
"""Distance of the neighbours that count, in distances of particles: the 26 around one in a lattice."""
_FLAT = 0.53
"""Mean offset of a particle of a flat face from its neighbours, in distances of particles: 9 of 17 lie below it."""


def outward_normals(positions: np.ndarray, gradients: np.ndarray, volumes: np.ndarray) -> np.ndarray:
    """Find the outward normals of particles on the surface, before the body deformed.

    Neighbours all around a particle balance each other; a surface has them on one side only.

    Args:
        positions: Shape [N, 3] [m].
        gradients: Deformation gradients F, shape [N, 3, 3]: a normal n of the deformed body was along F^T n.
        volumes: Rest volumes, shape [N] [m^3]; the largest one belongs to a whole cell of the lattice.

    Returns:
        Unit normals, 0 for particles within the body, float32 [N, 3].
    """
    spacing = float(np.cbrt(volumes.max()))
    one, other = cKDTree(positions).query_pairs(_NEIGHBOURS * spacing, output_type="ndarray").T
    offset = positions[one] - positions[other]
    total = np.zeros(positions.shape)
    np.add.at(total, one, offset)
    np.add.at(total, other, -offset)
    count = np.bincount(np.concatenate([one, other]), minlength=len(positions))
    on_surface = np.linalg.norm(total, axis=1) > 0.5 * _FLAT * spacing * count
    before = np.einsum("nji,nj->ni", gradients, total)
    length = np.maximum(np.linalg.norm(before, axis=1, keepdims=True), 1e-30)
    return np.where(on_surface[:, None], before / length, 0).astype(np.float32)
