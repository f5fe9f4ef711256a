"""The closed convex surface around points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from plop.errors import PlopError

_RIM_M = 0.006
"""Points this close to a table belong to the object's lower edge, which no camera sees [m]."""
_SKIN_M = 0.0025
"""Points this close to the hull are measurements of the surface [m]."""
_ALIKE = 0.9
"""Smallest cosine between the normals of two planes that share the points near them."""
_LEAST_NEAR = 30
"""Smallest number of measured points that locates a plane."""


@dataclass(frozen=True)
class _Planes:
    """Half-spaces n x + d <= 0, [P, 4], and which of them may be moved, [P]: all except the one on the table."""

    equations: np.ndarray
    free: np.ndarray

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how far points lie within the free planes [m], and which of these is nearest."""
        above = points @ self.equations[self.free, :3].T + self.equations[self.free, 3]
        return -above.max(1), above.argmax(1)

    def moved(self, inwards: np.ndarray | float) -> _Planes:
        """Move the free planes, each by its own or all by one distance [m]."""
        equations = self.equations.copy()
        equations[self.free, 3] += inwards
        return _Planes(equations, self.free)


def sides_of(hull: ConvexHull) -> np.ndarray:
    """Return the sides of a convex hull, one each: outward normal and offset, n x <= d inside; [P, 4], [-] and [m].

    Qhull gives one for every triangle; those of one side are merged within a nanometre.
    """
    return np.asarray(np.unique(hull.equations.round(9), axis=0) * [1, 1, 1, -1])


def convex_surface(
    points: np.ndarray,
    table_z_m: float | None = None,
    measured: np.ndarray | None = None,
    rim: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Fit a convex surface through the middle of noisy points, extended down to a table.

    The convex hull of noisy points lies outside nearly all of them. Its faces are therefore moved inwards, all by
    the same distance, until half of the points near them are outside. Points may have a common offset from the
    surface, as the centres of flat Gaussians have; flat ones would also extend beyond the outline of round objects
    and edges: with `measured` the faces then move to the middle of the measured points on the same side.

    Args:
        points: Positions on or in the object, [M, 3] [m].
        table_z_m: Height of a table that hides the object's lower edge [m]; None when there is none.
        measured: Noisy positions on the visible surface, [K, 3] [m].
        rim: Further positions of its footprint on the table (`plop.geometry.clouds.unseen_footprint`), [R, 3] [m].

    Returns:
        Vertices [V, 3] [m] and outward triangles [F, 3].

    Raises:
        PlopError: Fewer than four points, or all in one plane.
    """
    given = points
    if table_z_m is not None:
        points = points.copy()
        points[:, 2] = np.maximum(points[:, 2], table_z_m)  # below the table there is only noise
        below = points[points[:, 2] < table_z_m + _RIM_M].copy()
        below[:, 2] = table_z_m
        points = np.concatenate([points, below, *([] if rim is None else [rim])])
    try:
        planes = _drawn_in(ConvexHull(points).equations, given, table_z_m)
        if measured is not None:
            planes = _onto(planes, measured)
        corners = np.asarray(HalfspaceIntersection(planes.equations, points.mean(0)).intersections)
        hull = ConvexHull(corners)
    except (QhullError, ValueError) as error:
        raise PlopError(
            "The object's points enclose no volume.",
            expected="points on all sides of an object",
            found=f"{len(points)} points",
            fix="Check the masks of the first frame.",
        ) from error
    used, numbered = np.unique(hull.simplices, return_inverse=True)
    vertices, faces = corners[used].astype(np.float64), numbered.reshape(-1, 3)
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = ((corner[:, 0] - vertices.mean(0)) * normal).sum(1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces


def _drawn_in(equations: np.ndarray, points: np.ndarray, table_z_m: float | None) -> _Planes:
    """Move the planes of a hull inwards through the middle of the points near them."""
    free = np.ones(len(equations), bool)
    if table_z_m is not None:
        free = ~((equations[:, 2] < -0.99) & (np.abs(equations[:, 3] - table_z_m) < _RIM_M))
    planes = _Planes(equations, free)
    depth, _ = planes.nearest(points)
    near = depth[depth < _SKIN_M]
    return planes.moved(float(np.median(near)) if len(near) else 0.0)


def _onto(planes: _Planes, measured: np.ndarray) -> _Planes:
    """Move every plane to the middle of the measured points nearest to it or to planes of similar direction."""
    depth, nearest = planes.nearest(measured)
    near = np.abs(depth) < _SKIN_M
    depth, nearest = depth[near], nearest[near]
    if len(depth) < _LEAST_NEAR:
        return planes
    normals = planes.equations[planes.free, :3]
    shifts = np.full(len(normals), np.median(depth))
    for plane, own in enumerate(normals @ normals.T > _ALIKE):
        its = depth[own[nearest]]
        if len(its) >= _LEAST_NEAR:
            shifts[plane] = np.median(its)
    return planes.moved(shifts)
