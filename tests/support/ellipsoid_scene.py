"""A small scene with a closed form: an ellipsoid and a post on a table, seen by cameras around it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plop.geometry.cameras import Camera, look_at
from plop.recordings.recording import MaskLabel, Mesh
from plop.recordings.set import RecordingSet
from plop.recordings.writer import RecordingWriter

CENTER = np.array([0.0, 0.0, 0.03])
RADII = np.array([0.06, 0.04, 0.03])
POST_CENTER, POST_RADIUS = np.array([0.11, 0.03, 0.02]), 0.02
PLATE_CENTER, PLATE_RADII = np.array([0.0, 0.0, 0.1]), np.array([0.002, 0.08, 0.039])
TOOL = Mesh(
    np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]], float),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)


def ring(count: int = 6, size: int = 96, distance: float = 0.35, height: float = 0.25) -> list[Camera]:
    """Cameras on a circle that look at the ellipsoid."""
    matrix = np.array([[1.6 * size, 0, size / 2], [0, 1.6 * size, size / 2], [0, 0, 1.0]])
    angles = 2 * np.pi * np.arange(count) / count + 0.1
    eyes = np.stack([distance * np.cos(angles), distance * np.sin(angles), np.full(count, height)], 1)
    return [
        Camera(f"cam{i}", size, size, matrix, look_at(eye, CENTER, np.array([0, 0, 1.0]))) for i, eye in enumerate(eyes)
    ]


def render(camera: Camera, *, plate: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Trace the scene exactly, with a plate as tool just above the ellipsoid or without: rgb, depth [m], mask."""
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
    k = camera.intrinsics
    rays = np.stack([(columns + 0.5 - k[0, 2]) / k[0, 0], (rows + 0.5 - k[1, 2]) / k[1, 1], np.ones(rows.shape)], -1)
    directions = rays @ camera.world_from_cam[:3, :3].T
    eye = camera.world_from_cam[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        table = np.where(directions[..., 2] < -1e-9, -eye[2] / directions[..., 2], np.inf)
    hits = np.stack(
        [
            np.where(table < 0.8, table, np.inf),
            _ellipsoid(eye, directions, CENTER, RADII),
            _ellipsoid(eye, directions, POST_CENTER, np.full(3, POST_RADIUS)),
            *([_ellipsoid(eye, directions, PLATE_CENTER, PLATE_RADII)] if plate else []),
        ]
    )
    nearest = hits.argmin(0)
    depth = hits.min(0)
    labels = np.array([MaskLabel.BACKGROUND, MaskLabel.OBJECT, MaskLabel.BACKGROUND, MaskLabel.TOOL], np.uint8)
    mask = np.where(np.isfinite(depth), labels[nearest], MaskLabel.BACKGROUND).astype(np.uint8)
    depth = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    point = eye + depth[..., None] * directions
    stripes = 0.5 + 0.2 * np.sin(150 * point + np.array([0, 1, 2])) + 0.2 * np.sin(90 * point[..., [1, 2, 0]])
    return (255 * np.clip(stripes, 0, 1)).astype(np.uint8), depth, mask


def _ellipsoid(eye: np.ndarray, directions: np.ndarray, center: np.ndarray, radii: np.ndarray) -> np.ndarray:
    d, o = directions / radii, (eye - center) / radii
    a, b, c = (d * d).sum(-1), (d * o).sum(-1), (o * o).sum() - 1
    root = b * b - a * c
    return np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


def ellipsoid_distance(points: np.ndarray) -> np.ndarray:
    """Approximate signed distance to the ellipsoid (first order), [N, 3] -> [N] metres."""
    local = (points - CENTER) / RADII
    value = np.linalg.norm(local, axis=1)
    gradient = np.linalg.norm(local / RADII, axis=1) / value
    return (value - 1) / gradient


def write_recording(
    path: Path,
    cameras: list[Camera],
    *,
    frames: int = 2,
    truth: list[Camera] | None = None,
    table_z_m: float | None = 0.0,
    depth_factor: dict[str, float] | None = None,
    scan: list[Camera] | None = None,
    scan_truth: list[Camera] | None = None,
    masks: bool = True,
    plate: bool = False,
) -> None:
    """Write a still recording; `truth` holds the cameras that took the images when `cameras` are wrong."""
    tool_poses = np.tile(np.eye(4), (frames, 1, 1))
    tool_poses[:, 2, 3] = 0.2
    with RecordingWriter(
        path,
        name=path.stem,
        source="test",
        environment="scene",
        table_z_m=table_z_m,
        time_s=np.arange(frames) / 30,
        tool_mesh=TOOL,
        world_from_tool=tool_poses,
    ) as writer:
        for claimed, real in zip(cameras, truth or cameras, strict=True):
            rgb, depth, mask = render(real, plate=plate)
            mask = mask if masks else np.full_like(mask, MaskLabel.UNKNOWN)
            depth = depth * (depth_factor or {}).get(claimed.name, 1.0)
            writer.add_camera(
                claimed.name,
                claimed.intrinsics,
                np.tile(claimed.world_from_cam, (frames, 1, 1)),
                claimed.height,
                claimed.width,
            )
            for frame in range(frames):
                writer.write_frame(claimed.name, frame, rgb, depth, mask)
        if scan:
            poses = np.stack([camera.world_from_cam for camera in scan])
            writer.add_camera("wrist", scan[0].intrinsics, poses, scan[0].height, scan[0].width, group="scan")
            for index, camera in enumerate(scan_truth or scan):
                rgb, depth, mask = render(camera)
                mask = mask if masks else np.full_like(mask, MaskLabel.UNKNOWN)
                writer.write_frame("wrist", index, rgb, depth, mask, group="scan")


def write_set(folder: Path, episodes: dict[str, dict], **common) -> RecordingSet:
    """Write a recording set; each episode's entry overrides the common arguments of `write_recording`."""
    for name, own in episodes.items():
        write_recording(folder / "episodes" / f"{name}.h5", **{**common, **own})
    recordings = RecordingSet(folder, "scene", sorted(episodes), [])
    recordings.save()
    return recordings
