"""Point clouds with normals and colours: from depth images, joined, averaged, cleaned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from plop.errors import PlopError
from plop.geometry.cameras import Camera
from plop.geometry.rigid import transform_points

MILLIMETRES_ABOVE_M = 20.0
"""A median depth above this is taken as millimetres: no manipulation scene is 20 m deep."""


@dataclass(frozen=True)
class PointCloud:
    """Oriented, coloured surface points."""

    points: np.ndarray
    """[N, 3] float64 [m]"""
    normals: np.ndarray
    """[N, 3] float64, unit length, pointing out of the surface"""
    colors: np.ndarray
    """[N, 3] uint8"""

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, index: np.ndarray) -> PointCloud:
        """Select points; `index` is a bool mask or an index array."""
        return PointCloud(self.points[index], self.normals[index], self.colors[index])

    def moved(self, transform: np.ndarray) -> PointCloud:
        """Move the cloud by a rigid transform, shape [4, 4]."""
        return PointCloud(transform_points(transform, self.points), self.normals @ transform[:3, :3].T, self.colors)

    @property
    def extent_m(self) -> np.ndarray:
        """Edges of the bounding box, shape [3] [m]."""
        return np.ptp(self.points, axis=0) if len(self) else np.zeros(3)


def check_metres(depth_m: np.ndarray, where: str) -> None:
    """Raise when a depth image holds negative values or looks like millimetres.

    Args:
        depth_m: Shape [H, W], metres, 0 or NaN = not measured.
        where: Named in the error.

    Raises:
        PlopError: Depth is negative, or its median lies beyond 20.
    """
    measured = depth_m[np.isfinite(depth_m) & (depth_m != 0)]
    if len(measured) == 0:
        return
    if measured.min() < 0:
        raise PlopError(
            "A depth image has negative values.",
            where=where,
            expected="metres, 0 = not measured",
            found=f"minimum {measured.min():.3f}",
            fix="Write 0 where depth is not measured.",
        )
    middle = float(np.median(measured))
    if middle > MILLIMETRES_ABOVE_M:
        raise PlopError(
            "A depth image seems to be in millimetres.",
            where=where,
            expected="metres",
            found=f"a median depth of {middle:.0f}",
            fix="Divide the depth by 1000.",
        )


def cloud_from_depth(
    camera: Camera, depth_m: np.ndarray, rgb: np.ndarray, mask: np.ndarray | None = None, *, neighbors: int = 12
) -> PointCloud:
    """Turn one depth image into world points with normals that face the camera.

    Args:
        camera: Gives intrinsics and pose.
        depth_m: Shape [H, W], metres; 0 or NaN = not measured.
        rgb: Shape [H, W, 3], uint8.
        mask: Pixels to use, bool, shape [H, W]; all when absent.
        neighbors: Nearest points that each normal is fitted to.

    Returns:
        The cloud; empty when nothing is measured.
    """
    use = np.isfinite(depth_m) & (depth_m > 0)
    if mask is not None:
        use &= mask
    points = camera.back_project(depth_m, use)
    toward = camera.world_from_cam[:3, 3] - points
    return PointCloud(points, fit_normals(points, toward, neighbors), rgb[use])


def fit_normals(points: np.ndarray, toward: np.ndarray, neighbors: int = 12) -> np.ndarray:
    """Fit a plane to every point's neighbourhood and orient its normal.

    Args:
        points: Shape [N, 3], metres.
        toward: Directions that the normals should point to, shape [N, 3], any length.
        neighbors: Size of a neighbourhood, the point included.

    Returns:
        Unit normals, shape [N, 3]. With fewer than 3 points they are just `toward`, normalised.
    """
    fallback = toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12)
    count = min(neighbors, len(points))
    if count < 3:
        return np.asarray(fallback)
    _, index = cKDTree(points).query(points, k=count)
    offsets = points[index] - points[index].mean(1, keepdims=True)
    covariance = np.einsum("nki,nkj->nij", offsets, offsets)
    normals = np.linalg.eigh(covariance)[1][..., 0]
    sign = np.sign((normals * toward).sum(1, keepdims=True))
    return normals * np.where(sign == 0, 1, sign)


def join(clouds: Sequence[PointCloud]) -> PointCloud:
    """Concatenate clouds, in order."""
    if not clouds:
        return PointCloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    return PointCloud(*(np.concatenate([getattr(c, key) for c in clouds]) for key in ("points", "normals", "colors")))


def voxel_average(cloud: PointCloud, voxel_m: float) -> PointCloud:
    """Replace the points of every voxel by their mean position, normal and colour.

    Args:
        cloud: Any cloud.
        voxel_m: Edge of a voxel of the grid through the world's origin [m].

    Returns:
        One point per occupied voxel, ordered by voxel.
    """
    if len(cloud) == 0:
        return cloud
    cells = np.floor(cloud.points / voxel_m).astype(np.int64)
    _, group, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)

    def mean(values: np.ndarray) -> np.ndarray:
        columns = [np.bincount(group, weights=values[:, i]) for i in range(values.shape[1])]
        return np.stack(columns, axis=1) / count[:, None]

    normals = mean(cloud.normals)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    first = np.full(len(count), len(cloud), dtype=np.int64)
    np.minimum.at(first, group, np.arange(len(cloud)))
    normals = np.where(length < 0.1, cloud.normals[first], normals / np.maximum(length, 1e-12))
    colors = np.round(mean(cloud.colors.astype(np.float64))).astype(np.uint8)
    return PointCloud(mean(cloud.points), normals, colors)


def surface_distance_m(points: np.ndarray, surface: PointCloud, gate_m: float) -> np.ndarray:
    """Measure how far points lie from a surface: along the normal of the nearest surface point.

    Args:
        points: Shape [N, 3], metres.
        surface: Oriented cloud.
        gate_m: Points without a surface point within this distance are left out [m].

    Returns:
        Signed distances, positive outside, shape [K] with K <= N, metres.
    """
    if len(surface) == 0 or len(points) == 0:
        return np.zeros(0)
    distance, index = cKDTree(surface.points).query(points, distance_upper_bound=gate_m)
    near = np.isfinite(distance)
    return np.asarray(((points[near] - surface.points[index[near]]) * surface.normals[index[near]]).sum(1))


def outlier_free(cloud: PointCloud, *, neighbors: int = 16, deviations: float = 3.0) -> np.ndarray:
    """Find the points that are not isolated: inliers by the distance to their neighbours.

    Args:
        cloud: Any cloud.
        neighbors: Number of nearest points for the mean distance.
        deviations: A point is discarded when its mean distance exceeds the median by this many robust standard
            deviations (1.4826 times the median absolute deviation, at least 5 % of the median).

    Returns:
        Points to keep, bool, shape [N].
    """
    if len(cloud) <= neighbors:
        return np.ones(len(cloud), dtype=bool)
    distance, _ = cKDTree(cloud.points).query(cloud.points, k=neighbors + 1)
    mean = distance[:, 1:].mean(1)
    middle = np.median(mean)
    spread = max(1.4826 * float(np.median(np.abs(mean - middle))), 0.05 * float(middle))
    return np.asarray(mean <= middle + deviations * spread)


def largest_clusters(points: np.ndarray, gap_m: float, *, at_least: float = 0.05) -> np.ndarray:
    """Keep the clusters that hold a share of the points; clusters are chains of points closer than a gap.

    Args:
        points: Shape [N, 3], metres.
        gap_m: Points nearer than this belong together [m].
        at_least: Smallest share of the largest cluster's size that is kept, 0 to 1.

    Returns:
        Points to keep, bool, shape [N].
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    if len(points) == 0:
        return np.zeros(0, dtype=bool)
    pairs = cKDTree(points).query_pairs(gap_m, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    _, label = connected_components(links, directed=False)
    size = np.bincount(label)
    return np.asarray(size[label] >= at_least * size.max())
