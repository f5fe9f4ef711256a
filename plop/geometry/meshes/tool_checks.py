"""Checks of a tool's mesh for damage, and of the tool's distance from the scene.

Part of a file set to zero makes corners at exactly 0 0 0; a byte changed moves one corner, which no other triangle then
shares. Either leaves a surface that is closed except where these triangles belong. Valid meshes of poor quality differ:
collapsed triangles of a CAD export leave no hole, and an open sheet has a long rim. Poses in millimetres place the tool
far outside the scene.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from plop.errors import PlopError
from plop.geometry.meshes.mesh_topology import Topology, is_collapsed, welded
from plop.geometry.rigid import transform_points

FAR = 20.0
"""Largest plausible distance of a tool, in sizes of the scene or of the tool, whichever is larger."""
LEAST_FAR_M = 1.0
"""A tool closer than this is accepted, independent of the size of the scene [m]."""
_RIM_PER_STRAY = 3
"""Free edges left by one lost triangle."""
_RIM_OF_ENDS = 12
"""Free edges left by the two triangles at the ends of a lost range: their own, and those of their holes."""
_WHOLE_PER_STRAY = 5
"""Smallest number of intact triangles per stray one for the rest to count as a damaged surface."""
_NOTHING_M = 1e-9
"""A coordinate this small is zero: a number whose bytes are zero except the last ones is about 1e-39 [m]."""
_UNUSED_SHARE = 0.01
"""Vertices without a face may reach beyond the used ones by this share of the tool's size."""


def check_tool_mesh(vertices: np.ndarray, faces: np.ndarray, where: str) -> list[str]:
    """Reject a tool's mesh with lost, stray or collapsed triangles; note defects of usable ones.

    Args:
        vertices: Shape [V, 3] [m].
        faces: Shape [F, 3].
        where: File and key, for the message.

    Returns:
        Notes: an open surface, collapsed triangles, inconsistently oriented faces.

    Raises:
        PlopError: The mesh is damaged; names how many triangles, and where the first is.
    """
    joined = welded(vertices, faces)
    collapsed = is_collapsed(joined)
    at_zero = (np.abs(vertices).max(1) < _NOTHING_M)[faces]
    nothing = at_zero.all(1) | (collapsed & (at_zero.sum(1) == 2))
    if at_zero.all(1).any() or nothing.sum() > 1:
        raise _damaged(
            where,
            f"{int(nothing.sum())} of {len(faces)} triangles lie with two or three corners at exactly 0 0 0",
            vertices,
            faces,
            nothing,
        )
    if collapsed.all():
        raise _damaged(where, f"all {len(faces)} triangles are collapsed", vertices, faces, collapsed)
    uses = _edge_uses(joined, ~collapsed)
    free, alone = (uses == 1).any(axis=1), uses.max(axis=1) == 1
    around_zero = at_zero.any(1) & ~collapsed
    crowded = bool((around_zero & (uses.max(axis=1) > 2)).any())
    crowd_at_zero = crowded or _fans(joined[around_zero], joined[at_zero]) > 1
    lost = (collapsed & ~_in_place(joined, collapsed)) | (at_zero.any(1) & crowd_at_zero)
    stray = lost | alone | _lonely(joined, ~collapsed) | (at_zero.any(1) & free)
    count = int(stray.sum())
    rest = Topology.of(joined[~stray & ~collapsed])
    mostly = len(rest.faces) >= _WHOLE_PER_STRAY * int((stray & ~lost).sum())
    if 0 < rest.free_edges <= _RIM_PER_STRAY * count + _RIM_OF_ENDS * bool(lost.any()) and mostly:
        raise _damaged(
            where,
            f"{count} of {len(faces)} triangles are stray or collapsed, and the rest is closed but "
            f"for {rest.free_edges} edges",
            vertices,
            faces,
            stray,
        )
    _check_unused(vertices, faces, where)
    return _notes(joined[~collapsed], int(collapsed.sum()))


def _lonely(faces: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Faces with a corner that no other face shares: every vertex of a closed surface has three faces."""
    uses = np.bincount(faces[valid].reshape(-1), minlength=faces.max() + 1)
    return np.asarray(valid & (uses[faces] == 1).any(1))


def _in_place(faces: np.ndarray, collapsed: np.ndarray) -> np.ndarray:
    """Collapsed faces that close no gap: their one edge already has two other faces; bool, shape [F]."""
    edges, counts = np.unique(
        np.sort(faces[~collapsed][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0, return_counts=True
    )
    twice = {tuple(edge) for edge in edges[counts == 2].tolist()}
    ends = zip(faces.min(1).tolist(), faces.max(1).tolist(), strict=True)
    return np.array([flat and end in twice for flat, end in zip(collapsed.tolist(), ends, strict=True)])


def _fans(faces: np.ndarray, middle: np.ndarray) -> int:
    """Number of separate fans of faces around one vertex: several where distinct vertices were merged."""
    if not len(faces):
        return 0
    _, ends = np.unique(faces[faces != middle[0]], return_inverse=True)
    links = ends.reshape(-1, 2)
    size = int(ends.max()) + 1
    graph = coo_matrix((np.ones(len(links)), (links[:, 0], links[:, 1])), (size, size))
    return int(connected_components(graph, directed=False)[0])


def _edge_uses(faces: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Number of valid faces at each edge of each face, shape [F, 3]; 2 for all edges of the others."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    kept = np.repeat(valid, 3)
    _, edge, uses = np.unique(edges[kept], axis=0, return_inverse=True, return_counts=True)
    count: np.ndarray = np.full(len(edges), 2)
    count[kept] = uses[edge.reshape(-1)]
    return count.reshape(-1, 3)


def _check_unused(vertices: np.ndarray, faces: np.ndarray, where: str) -> None:
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    low, high = vertices[used].min(0), vertices[used].max(0)
    beyond = np.maximum(low - vertices, vertices - high).max(1)
    far = beyond > _UNUSED_SHARE * float((high - low).max())
    if far.any():
        raise PlopError(
            "The tool's mesh is damaged.",
            where=where,
            expected="vertices that belong to a triangle",
            found=f"{int(far.sum())} that belong to none, up to {1000 * beyond.max():.3g} mm from the tool",
            fix="Copy or export the mesh again; remove loose vertices.",
        )


def _notes(faces: np.ndarray, collapsed: int) -> list[str]:
    topology, notes = Topology.of(faces), []
    if collapsed:
        notes.append(f"{collapsed} collapsed triangles leave no hole and are harmless")
    if not topology.is_closed:
        crowded = f", {topology.crowded_edges} with more than two" if topology.crowded_edges else ""
        notes.append(
            f"the surface is not closed ({topology.free_edges} edges with one triangle{crowded}): the tool is "
            "treated as a sheet or a hollow body, not as a solid"
        )
    elif not topology.orientable or topology.turned.any():
        notes.append("neighbouring triangles are oriented inconsistently")
    return notes


def _damaged(where: str, found: str, vertices: np.ndarray, faces: np.ndarray, which: np.ndarray) -> PlopError:
    first = int(np.argmax(which))
    corners = ", ".join(f"({' '.join(f'{value:.4g}' for value in corner)})" for corner in vertices[faces[first]])
    return PlopError(
        "The tool's mesh is damaged.",
        where=where,
        expected="triangles that form one surface",
        found=f"{found}; the first is triangle {first}: {corners}",
        fix="Part of the file was lost: copy or export the mesh again (in Blender: Clean Up, Delete Loose "
        "and Degenerate Dissolve).",
    )


def check_tool_reach(tool_vertices: np.ndarray, world_from_tool: np.ndarray, scene: np.ndarray, where: str) -> None:
    """Reject a tool that in all frames is tens of scene sizes away; one that merely never touches is accepted.

    Args:
        tool_vertices: Shape [V, 3], in the tool's frame [m].
        world_from_tool: Pose of the tool at every frame, shape [T, 4, 4].
        scene: Points of the object or of the cameras, shape [N, 3], world [m].
        where: File and key of the poses, for the message.

    Raises:
        PlopError: The tool is too far away; the message names the unit.
    """
    low, high = scene.min(0), scene.max(0)
    size = max(float((high - low).max()), float(np.ptp(tool_vertices, axis=0).max()))
    points = np.stack([transform_points(pose, tool_vertices) for pose in world_from_tool])
    outside = np.maximum(np.maximum(low - points, points - high), 0)
    nearest = float(np.linalg.norm(outside, axis=-1).min())
    farthest = max(FAR * size, LEAST_FAR_M)
    if nearest > farthest:
        raise PlopError(
            "The tool is far from everything else in all frames.",
            where=where,
            expected=f"metres: a tool within {farthest:.3g} m of a scene of {size:.3g} m",
            found=f"{nearest:.4g} m away at its closest",
            fix="Translations in millimetres? Divide them by 1000, or correct the frame.",
        )
