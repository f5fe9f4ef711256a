"""Fill closed surfaces with particles."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plop.errors import PlopError
from plop.lazy_open3d import o3d

_LEAST_SHARE = 0.04
"""Particles with a smaller share of a cell are left out; their neighbours take the volume."""


def fill_surface(
    vertices: np.ndarray, faces: np.ndarray, spacing_m: float, *, samples: int = 4
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fill a closed surface with particles on a lattice, the outer ones on the surface itself.

    Nodes of the lattice within half a cell of the surface, inside or outside, are moved onto it. Every particle gets
    the volume that is nearer to it than to any other.

    Args:
        vertices: Shape [V, 3], metres.
        faces: Triangles of a closed surface, shape [F, 3].
        spacing_m: Edge of a cell; fitted to the bounding box [m].
        samples: Points per cell and axis that measure volumes.

    Returns:
        Positions [N, 3] [m], volumes [N] [m^3] and radii [N] [m]: 0 on the surface, half a cell inside.

    Raises:
        PlopError: Nothing is inside.
    """
    low, high = vertices.min(0), vertices.max(0)
    counts = np.maximum(1, np.round((high - low) / spacing_m)).astype(int)
    step = (high - low) / counts
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(np.ascontiguousarray(vertices, np.float32)),
        o3d.core.Tensor.from_numpy(np.ascontiguousarray(faces, np.uint32)),
    )
    points = _box_points(low + step / (2 * samples), step / samples, counts * samples)
    points = points[scene.compute_occupancy(_tensor(points), nsamples=3).numpy() > 0.5]
    if not len(points):
        raise PlopError(
            "The surface encloses no particle.",
            expected=f"a closed surface thicker than {spacing_m:g} m",
            found=f"a box of {(high - low).round(4).tolist()} m",
            fix="Lower the spacing.",
        )
    nodes = _box_points(low, step, counts + 1)
    depth = -scene.compute_signed_distance(_tensor(nodes), nsamples=3).numpy()
    half = 0.5 * float(step.min())
    inner, outer = nodes[depth > half], nodes[np.abs(depth) <= half]
    outer = scene.compute_closest_points(_tensor(outer))["points"].numpy().astype(float)
    places = np.concatenate([inner, outer])
    radii = np.concatenate([np.full(len(inner), 0.5 * float(np.cbrt(step.prod()))), np.zeros(len(outer))])
    for least in (_LEAST_SHARE, 0.0):
        owned = np.bincount(cKDTree(places).query(points)[1], minlength=len(places))
        keep = owned > least * samples**3
        places, radii, owned = places[keep], radii[keep], owned[keep]
    return places, owned * (step / samples).prod(), radii


def _box_points(low: np.ndarray, step: np.ndarray, counts: np.ndarray) -> np.ndarray:
    axes = [low[k] + step[k] * np.arange(counts[k]) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def _tensor(points: np.ndarray) -> o3d.core.Tensor:
    return o3d.core.Tensor.from_numpy(points.astype(np.float32))


def surface_parts(faces: np.ndarray, count: int) -> np.ndarray:
    """Number the connected parts of a surface.

    Args:
        faces: Triangles, shape [F, 3].
        count: Number of vertices.

    Returns:
        Part of every vertex, shape [count].
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
