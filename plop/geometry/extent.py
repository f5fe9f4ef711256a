"""How large an object is, whichever way it lies."""

from __future__ import annotations

import numpy as np


def box_edges_m(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Give the edges of the box that has a solid's second moments, longest first, [3] [m]; a box gets its own.

    Unlike a bounding box they do not depend on how the object is turned.

    Args:
        vertices: [V, 3] [m].
        faces: Outward triangles of a closed surface, [F, 3].
    """
    middle = vertices.mean(0)
    corners = (vertices - middle)[faces]
    volumes = np.linalg.det(corners) / 6
    # a tetrahedron with one corner at 0 and the others at a, b, c: integral of x x^T = V / 20 (sum a a^T + s s^T)
    total = corners.sum(1)
    outer = np.einsum("fki,fkj->fij", corners, corners) + np.einsum("fi,fj->fij", total, total)
    volume = volumes.sum()
    first = (volumes[:, None] * total).sum(0) / 4 / volume
    second = (volumes[:, None, None] * outer).sum(0) / 20 / volume
    spread = np.linalg.eigvalsh(second - np.outer(first, first))
    return np.asarray(np.sqrt(12 * np.maximum(spread, 0))[::-1])
