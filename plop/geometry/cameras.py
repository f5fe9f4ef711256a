"""Pinhole cameras with OpenCV axes (x right, y down, z forward)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.geometry.rigid import invert_rigid, transform_points


@dataclass(frozen=True)
class Camera:
    """One calibrated pinhole camera at one instant.

    Pixel centres are at half-integers: the ray of pixel (column u, row v) goes
    through image coordinates (u + 0.5, v + 0.5).
    """

    name: str
    width: int
    """[px]"""
    height: int
    """[px]"""
    intrinsics: np.ndarray
    """Matrix K, shape [3, 3], float64 [px]."""
    world_from_cam: np.ndarray
    """Pose, shape [4, 4], float64 [m]."""

    @property
    def cam_from_world(self) -> np.ndarray:
        """Pose of the world in the camera, shape [4, 4]."""
        return invert_rigid(self.world_from_cam)

    def project(self, points_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project world points.

        Args:
            points_world: Shape [N, 3], metres.

        Returns:
            Image coordinates [N, 2] in px and depth along the optical axis [N] in metres.
            Points with depth <= 0 are behind the camera; their coordinates are meaningless.
        """
        points = transform_points(self.cam_from_world, points_world)
        depth = points[:, 2]
        safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        pixels = points[:, :2] / safe[:, None] * [self.intrinsics[0, 0], self.intrinsics[1, 1]]
        return pixels + self.intrinsics[:2, 2], depth

    def pixels_of(self, points_world: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Find the pixel of each point [N, 3] [m]: whether it is in the image, row, column (0 where not), depth [m]."""
        pixel, depth = self.project(points_world)
        column, row = np.floor(np.clip(pixel.T, -1e6, 1e6)).astype(int)
        inside = (depth > 1e-6) & (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        return inside, np.where(inside, row, 0), np.where(inside, column, 0), depth

    def directions(self, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return directions through image coordinates [px], any shape [...] -> [..., 3], in the camera's axes.

        They have length 1 along the optical axis: times the depth they are points.
        """
        k = self.intrinsics
        return np.stack([(columns - k[0, 2]) / k[0, 0], (rows - k[1, 2]) / k[1, 1], np.ones_like(rows)], axis=-1)

    def pixel_directions(self) -> np.ndarray:
        """Return the directions through the middles of all pixels, shape [H, W, 3], see `directions`."""
        return self.directions(*np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5))

    def back_project(self, depth_m: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
        """Turn a depth image into world points, one per measured pixel, in row-major order.

        Args:
            depth_m: Depth along the optical axis, shape [H, W], metres; 0 or NaN is not measured.
            mask: Pixels to use, bool, shape [H, W]; all when absent.

        Returns:
            World points, shape [N, 3], float64, metres.
        """
        use = np.isfinite(depth_m) & (depth_m > 0)
        if mask is not None:
            use &= mask
        rows, columns = np.nonzero(use)
        depth = depth_m[rows, columns].astype(np.float64)
        points = self.directions(columns + 0.5, rows + 0.5) * depth[:, None]
        return transform_points(self.world_from_cam, points)

    def resized(self, width: int, height: int) -> Camera:
        """Return the same camera at another resolution, intrinsics scaled to match."""
        scale = np.array([width / self.width, height / self.height, 1.0])
        return Camera(self.name, width, height, self.intrinsics * scale[:, None], self.world_from_cam)


def look_at(eye: np.ndarray, target: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Build `world_from_cam` of a camera at `eye` looking at `target`.

    Args:
        eye: Position, shape [3], metres.
        target: Point in the middle of the image, shape [3], metres.
        up: World direction that points up in the image, shape [3]; not parallel to the view.

    Returns:
        Pose, shape [4, 4], OpenCV axes.
    """
    forward = np.asarray(target, float) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = eye
    return pose
