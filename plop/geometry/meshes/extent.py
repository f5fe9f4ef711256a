"""The size of an object, independent of its orientation."""

from __future__ import annotations

import numpy as np
from trimesh.triangles import mass_properties


def box_edges_m(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the edges of the box that has a solid's second moments, longest first, [3] [m]; a box gets its own.

    Unlike a bounding box they do not depend on the object's orientation.

    Args:
        vertices: [V, 3] [m].
        faces: Outward triangles of a closed surface, [F, 3].
    """
    solid = mass_properties(vertices[faces])
    second = np.trace(solid.inertia) / 2 * np.eye(3) - solid.inertia
    return np.asarray(np.sqrt(12 * np.maximum(np.linalg.eigvalsh(second) / solid.volume, 0))[::-1])
