"""The closed convex surface around points."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from plop.errors import PlopError

_RIM_M = 0.006
"""Points this near to a table belong to the object's edge there, which no camera sees [m]."""


def convex_surface(points: np.ndarray, table_z_m: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Wrap points in their convex hull, continued down to a table.

    Args:
        points: Places on or in the object, [M, 3] [m].
        table_z_m: Height of a table that hides the object's lower edge [m]; None when there is none.

    Returns:
        Vertices [V, 3] [m] and outward triangles [F, 3].

    Raises:
        PlopError: Fewer than four points, or all in one plane.
    """
    if table_z_m is not None:
        rim = points[points[:, 2] < table_z_m + _RIM_M].copy()
        rim[:, 2] = table_z_m
        points = np.concatenate([points, rim])
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise PlopError("The object's points enclose nothing.", expected="points all around an object",
                        found=f"{len(points)} points",
                        fix="Check the masks of the first frame.") from error  # fmt: skip
    used, numbered = np.unique(hull.simplices, return_inverse=True)
    vertices, faces = points[used].astype(np.float64), numbered.reshape(-1, 3)
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = ((corner[:, 0] - vertices.mean(0)) * normal).sum(1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces
