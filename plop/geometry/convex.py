"""The closed convex surface around points."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from plop.errors import PlopError

_RIM_M = 0.006
"""Points this near to a table belong to the object's edge there, which no camera sees [m]."""
_SKIN_M = 0.0025
"""Points this near to the hull are measurements of the surface [m]."""


def convex_surface(points: np.ndarray, table_z_m: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Wrap points in a convex surface that runs through the middle of their noise, continued down to a table.

    The convex hull of noisy points lies outside nearly all of them. Its faces are therefore drawn in, all by
    the same distance, until half of the points near them are outside.

    Args:
        points: Places on or in the object, [M, 3] [m].
        table_z_m: Height of a table that hides the object's lower edge [m]; None when there is none.

    Returns:
        Vertices [V, 3] [m] and outward triangles [F, 3].

    Raises:
        PlopError: Fewer than four points, or all in one plane.
    """
    measured = points
    if table_z_m is not None:
        points = points.copy()
        points[:, 2] = np.maximum(points[:, 2], table_z_m)  # nothing is below the table but noise
        rim = points[points[:, 2] < table_z_m + _RIM_M].copy()
        rim[:, 2] = table_z_m
        points = np.concatenate([points, rim])
    try:
        planes = ConvexHull(points).equations
        drawn_in = _drawn_in(planes, measured, points.mean(0), table_z_m)
        hull = ConvexHull(drawn_in)
    except (QhullError, ValueError) as error:
        raise PlopError("The object's points enclose nothing.", expected="points all around an object",
                        found=f"{len(points)} points",
                        fix="Check the masks of the first frame.") from error  # fmt: skip
    used, numbered = np.unique(hull.simplices, return_inverse=True)
    vertices, faces = drawn_in[used].astype(np.float64), numbered.reshape(-1, 3)
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = ((corner[:, 0] - vertices.mean(0)) * normal).sum(1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces


def _drawn_in(planes: np.ndarray, points: np.ndarray, inside: np.ndarray, table_z_m: float | None) -> np.ndarray:
    """Move the planes n x + d <= 0 inwards through the middle of the points near them; corners of what is left."""
    moved = planes.copy()
    free = np.ones(len(planes), bool)
    if table_z_m is not None:
        free = ~((planes[:, 2] < -0.99) & (np.abs(planes[:, 3] - table_z_m) < _RIM_M))
    depth = -(points @ planes[free, :3].T + planes[free, 3]).max(1)
    near = depth[depth < _SKIN_M]
    moved[free, 3] += float(np.median(near)) if len(near) else 0.0
    return np.asarray(HalfspaceIntersection(moved, inside).intersections)
