"""Interpolation of the motion of tracked points: moves the object's surface and its Gaussians."""

from __future__ import annotations

from math import dist

import numpy as np
from scipy.spatial import cKDTree

from plop.gaussians.state import Gaussians

NEIGHBOURS = 4
"""Number of tracked points that move one position."""
_SOFT_M = 1e-3


class MotionInterpolation:
    """Moves positions with the nearest tracked points on the same side of the cut.

    Args:
        points: Tracked points at the first frame, [M, 3] [m].
        patch: Patch of every point, [M]; patches do not extend across the cut.
        places: Positions to move, at the first frame, [V, 3] [m].
    """

    def __init__(self, points: np.ndarray, patch: np.ndarray, places: np.ndarray) -> None:
        nearest = patch[cKDTree(points).query(places)[1]]
        self.index = np.zeros((len(places), NEIGHBOURS), np.int64)
        """Tracked points of each position, [V, NEIGHBOURS]."""
        self.weight = np.zeros((len(places), NEIGHBOURS))
        """Their weights, [V, NEIGHBOURS]; each row sums to 1."""
        self.places, self._points = places, points
        for label in np.unique(nearest):
            own, rows = np.flatnonzero(patch == label), np.flatnonzero(nearest == label)
            count = min(NEIGHBOURS, len(own))
            distance, index = cKDTree(points[own]).query(places[rows], k=range(1, count + 1))
            weight = 1 / (distance + _SOFT_M) ** 2
            self.index[rows, :count] = own[index]
            self.weight[rows, :count] = weight / weight.sum(1, keepdims=True)

    def places_at(self, points: np.ndarray) -> np.ndarray:
        """Return the positions when the tracked points are at `points` [M, 3] [m]; [V, 3] [m]."""
        return np.asarray(self.places + self.values(points - self._points))

    def values(self, values: np.ndarray) -> np.ndarray:
        """Average values of the tracked points, [M, ...] -> [V, ...]."""
        weight = self.weight.reshape(*self.weight.shape, *([1] * (values.ndim - 1)))
        return np.asarray((weight * values[self.index]).sum(1))

    def gaussians_at(self, first: Gaussians, points: np.ndarray) -> Gaussians:
        """Move Gaussians whose means are the positions; orientation and extent are kept."""
        means = first.means.new_tensor(self.places_at(points))
        return first.with_(means=means)


def fine_surface(vertices: np.ndarray, faces: np.ndarray, edge_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Divide triangles at their longest edge until none is longer than `edge_m`.

    Neighbours are divided at the same edges, so that a closed surface stays closed.

    Args:
        vertices: [V, 3] [m].
        faces: [F, 3].
        edge_m: Largest edge length [m].

    Returns:
        Vertices [V', 3] [m] and triangles [F', 3]; the given vertices come first.
    """
    places = [tuple(v) for v in np.asarray(vertices, float).tolist()]
    middles: dict[tuple[int, int], int] = {}
    todo, done = [tuple(face) for face in np.asarray(faces).tolist()], []
    while todo:  # in plain floats: numpy takes ten times as long for three numbers
        face = todo.pop()
        lengths = [dist(places[face[k]], places[face[k - 2]]) for k in range(3)]
        first = lengths.index(max(lengths))
        if lengths[first] <= edge_m:
            done.append(face)
            continue
        a, b, c = face[first], face[first - 2], face[first - 1]
        key = (min(a, b), max(a, b))
        if key not in middles:
            middles[key] = len(places)
            places.append(tuple((p + q) / 2 for p, q in zip(places[a], places[b], strict=True)))
        todo += [(a, middles[key], c), (middles[key], b, c)]
    return np.array(places), np.array(done, np.int64)
