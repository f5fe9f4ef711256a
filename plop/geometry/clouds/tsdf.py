"""Fuse depth images into a truncated signed distance volume (open3d's voxel block grid)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from plop.errors import PlopError
from plop.geometry.clouds.pointcloud import PointCloud
from plop.geometry.view import View
from plop.lazy_open3d import o3d


def build_volume(
    frames: Sequence[View], voxel_m: float, *, max_depth_m: float = 10.0, band: float = 4.0, blocks: int = 4000
) -> Any:
    """Integrate frames into a voxel block grid (Curless and Levoy 1996; blocks hashed as by Niessner et al. 2013).

    Args:
        frames: Views; their labels are ignored.
        voxel_m: Edge of a voxel [m].
        max_depth_m: Depth beyond this is ignored [m].
        band: Half width of the truncated band in voxels.
        blocks: Blocks of 8x8x8 voxels reserved at first; the table grows.

    Returns:
        An `open3d.t.geometry.VoxelBlockGrid`.

    Raises:
        PlopError: There is no frame, or no frame has depth.
    """
    frames = [frame for frame in frames if (frame.depth_m > 0).any()]
    if not frames:
        raise PlopError("There is nothing to fuse.", expected="at least one image with measured depth", found="none")
    core = o3d.core
    widths: Any = ((1), (1), (3))
    grid = o3d.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight", "color"),
        (core.float32, core.float32, core.float32),
        widths,
        voxel_m,
        8,
        blocks,
        core.Device("CPU:0"),
    )
    for frame in frames:
        depth = o3d.t.geometry.Image(core.Tensor.from_numpy(np.ascontiguousarray(frame.depth_m, dtype=np.float32)))
        color = o3d.t.geometry.Image(core.Tensor.from_numpy(np.ascontiguousarray(frame.rgb, dtype=np.float32) / 255.0))
        # Integration takes the pixel whose square holds the projection: pixel centres at half-integers, as here.
        matrix = core.Tensor.from_numpy(np.ascontiguousarray(frame.camera.intrinsics, dtype=np.float64))
        pose = core.Tensor.from_numpy(np.ascontiguousarray(frame.camera.cam_from_world, dtype=np.float64))
        found = grid.compute_unique_block_coordinates(depth, matrix, pose, 1.0, max_depth_m, band)
        grid.integrate(found, depth, color, matrix, matrix, pose, 1.0, max_depth_m, band)
    return grid


def fuse_tsdf(
    frames: Sequence[View], voxel_m: float, *, max_depth_m: float = 10.0, band: float = 4.0, min_weight: float = 1.0
) -> PointCloud:
    """Fuse posed RGB-D images and extract the zero crossings as an oriented cloud.

    Args:
        frames: Views; their labels are ignored.
        voxel_m: Edge of a voxel [m].
        max_depth_m: Depth beyond this is ignored [m].
        band: Half width of the truncated band in voxels.
        min_weight: A voxel counts when at least this many images saw it.

    Returns:
        Cloud with about one point per voxel edge that the surface crosses, sorted by position.

    Raises:
        PlopError: There is nothing to fuse, or the fusion yields no surface.
    """
    grid = build_volume(frames, voxel_m, max_depth_m=max_depth_m, band=band)
    found = grid.extract_point_cloud(weight_threshold=min_weight - 0.5)
    points = found.point.positions.numpy().astype(np.float64)
    if len(points) == 0:
        raise PlopError(
            "The fusion yields no surface.",
            expected="zero crossings",
            found="none",
            fix="Use a larger voxel_m, or check poses and units of depth (metres).",
        )
    normals = found.point.normals.numpy().astype(np.float64)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    colors = np.clip(np.round(255 * found.point.colors.numpy()), 0, 255).astype(np.uint8)
    cloud = PointCloud(points, normals, colors)
    return cloud[np.lexsort(points.T)]
