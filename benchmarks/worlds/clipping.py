"""Cut a tetrahedral mesh by a plane into two parts with closed surfaces that coincide in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.worlds.scene import TetrahedralMesh, boundary

Corner = tuple[int, int]
"""A vertex of a part: (n, n) is node n, (i, j) the point on the edge from i, in the part, to j, beyond the plane."""


@dataclass(frozen=True)
class Clipped:
    """Both parts, as one mesh of triangles."""

    mesh: TetrahedralMesh
    normal: np.ndarray
    """Of the plane, [3]."""
    offset_m: float
    """Of the plane from the origin, along its normal [m]."""
    corners: np.ndarray
    """The two nodes of each vertex, see `Corner`, [V, 2]."""
    vertices: np.ndarray
    """[V, 3] [m]."""
    faces: np.ndarray
    """Outward, [F, 3]."""
    cut_faces: np.ndarray
    """Faces in the plane, bool [F]."""

    @property
    def upper(self) -> np.ndarray:
        """Vertices of the part towards which the normal points, bool [V]."""
        return np.asarray(self.mesh.nodes[self.corners[:, 0]] @ self.normal > self.offset_m)


def clipped(mesh: TetrahedralMesh, normal: np.ndarray, offset_m: float) -> Clipped:
    """Cut a mesh by the plane `normal` [3] . x = `offset_m` [m]."""
    height = mesh.nodes @ normal - offset_m
    crossed = mesh.tetrahedra[np.ptp((height > 0).astype(int)[mesh.tetrahedra], axis=1) > 0].tolist()
    loops: list[list[Corner]] = []
    in_plane = []
    for side in (1, -1):
        inside = (side * height > 0).tolist()
        outer = [_clipped_face(face, inside) for face in mesh.surface[mesh.faces].tolist()]
        section = [_section(tet, inside, height, mesh.nodes, -side * normal) for tet in crossed]
        loops += outer + section
        in_plane += [False] * len(outer) + [True] * len(section)
    fans = [(loop[0], *pair) for loop in loops for pair in zip(loop[1:-1], loop[2:], strict=True)]
    flags = np.repeat(in_plane, [max(0, len(loop) - 2) for loop in loops])
    corners, faces = np.unique(np.array(fans).reshape(-1, 2), axis=0, return_inverse=True)
    first, second = corners.T
    gap = height[first] - height[second]
    weight = np.divide(height[first], gap, out=np.zeros(len(corners)), where=first != second)[:, None]
    vertices = mesh.nodes[first] * (1 - weight) + mesh.nodes[second] * weight
    return Clipped(mesh, normal, float(offset_m), corners, vertices, faces.reshape(-1, 3), flags)


def _clipped_face(face: list[int], inside: list[bool]) -> list[Corner]:
    """Keep what lies inside, in the order of the face (Sutherland & Hodgman 1974)."""
    loop: list[Corner] = []
    for here, there in zip(face, face[1:] + face[:1], strict=True):
        if inside[here]:
            loop.append((here, here))
        if inside[here] != inside[there]:
            loop.append((here, there) if inside[here] else (there, here))
    return loop


def _section(
    tet: list[int], inside: list[bool], height: np.ndarray, nodes: np.ndarray, out: np.ndarray
) -> list[Corner]:
    """Intersect a tetrahedron with the plane; counter-clockwise seen against `out` [3]."""
    kept, gone = [n for n in tet if inside[n]], [n for n in tet if not inside[n]]
    loop = [(a, b) for a in kept for b in gone]
    if len(loop) == 4:
        loop = [loop[0], loop[1], loop[3], loop[2]]
    i, j = np.array(loop).T
    t = (height[i] / (height[i] - height[j]))[:, None]
    points = nodes[i] * (1 - t) + nodes[j] * t
    backward = np.cross(points[1] - points[0], points[2] - points[0]) @ out < 0
    return [loop[0], *loop[:0:-1]] if backward else loop


def upper_half(mesh: TetrahedralMesh) -> TetrahedralMesh:
    """Keep the tetrahedra above z = 0, which must be a layer of nodes."""
    above = mesh.nodes[:, 2] > -1e-9
    tetrahedra = mesh.tetrahedra[above[mesh.tetrahedra].all(1)]
    kept, numbers = np.unique(tetrahedra, return_inverse=True)
    tetrahedra = numbers.reshape(-1, 4)
    surface, faces = boundary(tetrahedra)
    return TetrahedralMesh(mesh.nodes[kept], tetrahedra, surface, faces)


def thickness_m(mesh: TetrahedralMesh) -> float:
    """Find the least height of all tetrahedra [m]."""
    corners = mesh.nodes[mesh.tetrahedra]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    sides = [np.delete(corners, k, 1) for k in range(4)]
    areas = [np.linalg.norm(np.cross(s[:, 1] - s[:, 0], s[:, 2] - s[:, 0]), axis=1) / 2 for s in sides]
    return float((3 * volume / np.max(areas, 0)).min())
