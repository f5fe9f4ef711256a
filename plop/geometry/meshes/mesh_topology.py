"""Topology of a triangle mesh: free edges, consistent orientation of faces, collapsed faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components

SAME_PLACE = 1e-6
"""Corners closer than this share of the bounding box's longest edge are merged: float32 keeps seven digits."""


def welded(places: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Merge corners at the same position into one vertex, as files without shared vertices (STL) need.

    Args:
        places: Position of every vertex, in one or several frames, shape [V, 3] or [T, V, 3]; only those that
            coincide in all of them are merged, so that the two sides of a cut stay separate.
        faces: Shape [F, 3].

    Returns:
        The faces with other indices, shape [F, 3].
    """
    frames = places.reshape(-1, *places.shape[-2:])
    size = float(np.ptp(frames[0], axis=0).max()) or 1.0
    cells = np.round(np.moveaxis(frames, 0, 1).reshape(frames.shape[1], -1) / (SAME_PLACE * size)).astype(np.int64)
    _, one = np.unique(cells, axis=0, return_inverse=True)
    return np.asarray(one.reshape(-1)[faces])


def is_collapsed(faces: np.ndarray) -> np.ndarray:
    """Return which faces have two corners in one, bool, shape [F]."""
    return np.asarray((faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0]))


@dataclass(frozen=True)
class Topology:
    """Connectivity of the faces of a mesh, welded and without collapsed ones."""

    faces: np.ndarray
    """Shape [F, 3]."""
    free_edges: int
    """Edges with a face on one side only."""
    crowded_edges: int
    """Edges with three faces or more."""
    piece: np.ndarray
    """Number of the connected piece of every face, int, shape [F]."""
    turned: np.ndarray
    """Faces that must be flipped to agree with the first face of their piece, bool, shape [F]."""
    orientable: bool
    """False: no flips make all neighbours agree."""

    @property
    def is_closed(self) -> bool:
        """Whether every edge has exactly two faces."""
        return self.free_edges == 0 and self.crowded_edges == 0

    @classmethod
    def of(cls, faces: np.ndarray) -> Topology:
        """Compute the connectivity.

        Args:
            faces: Welded faces, none collapsed, shape [F, 3].
        """
        count = len(faces)
        corners = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        face = np.tile(np.arange(count), 3)
        ordered = np.sort(corners, axis=1)
        _, edge, uses = np.unique(ordered, axis=0, return_inverse=True, return_counts=True)
        edge = edge.reshape(-1)
        order = np.argsort(edge, kind="stable")
        pairs = order[uses[edge[order]] == 2].reshape(-1, 2)
        one, other = face[pairs[:, 0]], face[pairs[:, 1]]
        disagree = (corners[pairs[:, 0]] == corners[pairs[:, 1]]).all(1)
        graph = coo_matrix((np.ones(2 * len(pairs)), (np.r_[one, other], np.r_[other, one])), (count, count)).tocsr()
        _, piece = connected_components(graph, directed=False)
        turned = _turned(graph, piece, one, other, disagree)
        orientable = bool(((turned[one] ^ turned[other]) == disagree).all())
        return cls(faces, int((uses == 1).sum()), int((uses > 2).sum()), piece, turned, orientable)


def _turned(
    graph: coo_matrix, piece: np.ndarray, one: np.ndarray, other: np.ndarray, disagree: np.ndarray
) -> np.ndarray:
    """Traverse every piece from its first face, flipping each face that disagrees with its predecessor."""
    count = graph.shape[0]
    turned = np.zeros(count, bool)
    if not disagree.any():
        return turned
    pair = dict(zip(zip(one.tolist(), other.tolist(), strict=True), disagree.tolist(), strict=True))
    for start in np.unique(piece, return_index=True)[1]:
        order, before = breadth_first_order(graph, int(start), directed=False)
        for face in order[1:].tolist():
            reached = int(before[face])
            flip = pair.get((reached, face), pair.get((face, reached), False))
            turned[face] = turned[reached] ^ flip
    return turned


def volumes(vertices: np.ndarray, faces: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Signed volume inside each piece, positive where its faces point outwards, shape [P] [m^3].

    Args:
        vertices: Shape [V, 3] [m].
        faces: Shape [F, 3].
        piece: Number of the piece of every face, shape [F].
    """
    corner = vertices[faces] - vertices[faces].reshape(-1, 3).mean(0)
    each = np.einsum("ij,ij->i", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6
    return np.bincount(piece, each)
