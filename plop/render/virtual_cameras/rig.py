"""Poses of the virtual cameras: two rings around the object, all looking at its middle."""

from __future__ import annotations

import numpy as np

from plop.geometry.cameras import Camera, look_at


def ring_cameras(
    rest_vertices: np.ndarray,
    *,
    count: int,
    size_px: int,
    fov_deg: float,
    low_deg: float,
    high_deg: float,
    azimuth_deg: float,
    room_m: float,
    distance_m: float = 0.0,
) -> list[Camera]:
    """Place cameras evenly around the object, alternately on a low and on a high ring.

    Args:
        rest_vertices: The object at rest, shape [V, 3] [m]; the same object gives the same cameras.
        count: Number of cameras.
        size_px: Width and height of the images [px].
        fov_deg: Full field of view across the image [deg].
        low_deg: Elevation of the low ring [deg].
        high_deg: Elevation of the high ring [deg].
        azimuth_deg: Direction of the first camera, from x towards y [deg].
        room_m: Free space around the object that stays in view [m].
        distance_m: Distance from the object's middle [m]; 0 fits object and room into the image.

    Returns:
        Cameras named cam_00, cam_01, ...
    """
    middle = (rest_vertices.min(0) + rest_vertices.max(0)) / 2
    half_fov = np.radians(fov_deg) / 2
    reach = float(np.linalg.norm(rest_vertices - middle, axis=1).max()) + room_m
    distance = distance_m or reach / np.sin(half_fov)
    focal = size_px / 2 / np.tan(half_fov)
    intrinsics = np.array([[focal, 0, size_px / 2], [0, focal, size_px / 2], [0, 0, 1]])
    cameras = []
    for index, name in enumerate(camera_names(count)):
        azimuth = np.radians(azimuth_deg + 360 / count * index)
        elevation = np.radians(high_deg if index % 2 else low_deg)
        direction = np.array(
            [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
        )
        pose = look_at(middle + distance * direction, middle, np.array([0.0, 0.0, 1.0]))
        cameras.append(Camera(name, size_px, size_px, intrinsics, pose))
    return cameras


def camera_names(count: int) -> list[str]:
    """Return the names of a ring's cameras."""
    return [f"cam_{index:02d}" for index in range(count)]
