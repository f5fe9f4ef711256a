"""Refine the poses of a scan from its images alone (pycolmap), at metric scale."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap

from plop.errors import PlopError
from plop.geometry.cameras import Camera


@dataclass(frozen=True)
class RefinedScan:
    """Poses that agree with the images."""

    world_from_cam: np.ndarray
    """[V, 4, 4] [m]; a view that could not be placed keeps its reference pose"""
    placed: np.ndarray
    """[V] bool: views placed by their images"""
    reprojection_px: float
    """Root mean square over all triangulated features [px]."""
    scale: float
    """Metres per unit of the reconstruction."""
    points: np.ndarray
    """Triangulated features in the world, shape [P, 3] [m]"""


def refine_scan(
    images: Sequence[np.ndarray],
    cameras: Sequence[Camera],
    *,
    scale_from: str = "poses",
    depths_m: Sequence[np.ndarray] | None = None,
    seed: int = 0,
) -> RefinedScan:
    """Place the views of a scan by their images and put them back into the world at metric scale.

    Structure from motion (Schoenberger and Frahm 2016) with known intrinsics gives poses up to a similarity;
    the similarity comes from the reference poses (robot or board), or its scale from measured depth.

    Args:
        images: RGB, shape [H, W, 3], uint8, undistorted.
        cameras: Same length; intrinsics, and reference poses from the robot or a board.
        scale_from: "poses" or "depth".
        depths_m: Depth images [H, W] for scale_from="depth", metres, 0 = not measured.
        seed: Makes the estimate repeatable.

    Raises:
        PlopError: Lengths differ, fewer than three views, too little texture or motion, no depth at features.
    """
    if len(images) != len(cameras) or (depths_m is not None and len(depths_m) != len(images)):
        raise PlopError(
            "Images, cameras and depths of a scan do not pair up.",
            expected=f"{len(cameras)} of each",
            found=f"{len(images)} images",
        )
    if len(images) < 3:
        raise PlopError("A scan needs views.", expected="at least 3", found=f"{len(images)}")
    if scale_from not in ("poses", "depth") or (scale_from == "depth" and depths_m is None):
        raise PlopError(
            "The scale of a scan has no source.", expected='"poses", or "depth" with depth images', found=scale_from
        )
    model = _structure_from_motion(images, cameras[0], seed)
    index = {int(image.name[:6]): image for image in model.images.values() if image.has_pose}
    own = {i: np.vstack([image.cam_from_world().inverse().matrix(), [0, 0, 0, 1]]) for i, image in index.items()}
    order = sorted(own)
    reference = np.stack([cameras[i].world_from_cam for i in order])
    mine = np.stack([own[i] for i in order])
    scale = None if scale_from == "poses" else _depth_scale(model, index, depths_m or [])
    scale, rotation, translation = align_poses(mine, reference, scale=scale)
    poses = np.stack([camera.world_from_cam for camera in cameras]).astype(np.float64)
    poses[order, :3, :3] = rotation @ mine[:, :3, :3]
    poses[order, :3, 3] = scale * mine[:, :3, 3] @ rotation.T + translation
    placed = np.zeros(len(cameras), dtype=bool)
    placed[order] = True
    points = np.array([p.xyz for p in model.points3D.values()]).reshape(-1, 3)
    errors = np.array([p.error for p in model.points3D.values()])
    return RefinedScan(
        poses, placed, float(np.sqrt(np.mean(errors**2))), scale, scale * points @ rotation.T + translation
    )


def align_poses(
    poses: np.ndarray, reference: np.ndarray, *, scale: float | None = None
) -> tuple[float, np.ndarray, np.ndarray]:
    """Find the similarity that takes poses onto reference poses.

    The rotation is the mean of the relative rotations, so that even camera centres on a line suffice; scale
    and translation are least squares over the centres, repeated on those within three median distances.

    Args:
        poses: Shape [V, 4, 4], any unit.
        reference: Shape [V, 4, 4] [m].
        scale: Known scale; solved for when absent.

    Returns:
        Scale, rotation [3, 3], translation [3]: x_reference = scale * rotation @ x + translation.

    Raises:
        PlopError: The centres coincide, so that no scale follows.
    """
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(reference[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2))
    keep = np.ones(len(poses), dtype=bool)
    found, shift, rotation = scale or 1.0, np.zeros(3), np.eye(3)
    for _ in range(4):
        rotation = turns[keep].mean().as_matrix()
        a, b = poses[:, :3, 3] @ rotation.T, reference[:, :3, 3]
        da, db = a[keep] - a[keep].mean(0), b[keep] - b[keep].mean(0)
        if scale is None:
            if (da * da).sum() < 1e-18 or (db * db).sum() < 1e-12:
                raise PlopError(
                    "The cameras of a scan stand still: no scale follows from their poses.",
                    expected="a moving camera",
                    fix='Use the depth (scale_from="depth").',
                )
            found = float((da * db).sum() / (da * da).sum())
        shift = b[keep].mean(0) - found * a[keep].mean(0)
        distance = np.linalg.norm(found * a + shift - b, axis=1)
        keep = distance <= max(3 * float(np.median(distance)), 1e-9)
    return found, rotation, shift


def _structure_from_motion(images: Sequence[np.ndarray], camera: Camera, seed: int) -> Any:
    pycolmap.set_random_seed(seed)
    pycolmap.logging.minloglevel = 2
    k = camera.intrinsics
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE"
    reader.camera_params = f"{k[0, 0]},{k[1, 1]},{k[0, 2]},{k[1, 2]}"
    extraction, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    extraction.num_threads = matching.num_threads = 1
    extraction.use_gpu = matching.use_gpu = False
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = options.ba_refine_principal_point = False
    options.num_threads, options.random_seed, options.multiple_models = 1, seed, False
    options.min_model_size = 3
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "images").mkdir()
        (folder / "model").mkdir()
        for number, image in enumerate(images):
            cv2.imwrite(str(folder / "images" / f"{number:06d}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        database, pictures = folder / "features.db", folder / "images"
        pycolmap.extract_features(
            database,
            pictures,
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options=reader,
            extraction_options=extraction,
            device=pycolmap.Device.cpu,
        )
        pycolmap.match_exhaustive(database, matching_options=matching, device=pycolmap.Device.cpu)
        models = pycolmap.incremental_mapping(database, pictures, folder / "model", options)
    if not models:
        raise PlopError(
            "The views of a scan cannot be placed by their images.",
            expected="textured, overlapping views",
            found="no reconstruction",
            fix="Put a textured cloth or a board beside the object, or move slower.",
        )
    return max(models.values(), key=lambda model: model.num_reg_images())


def _depth_scale(model: Any, index: dict[int, Any], depths_m: Sequence[np.ndarray]) -> float:
    """Give metres per unit: the median ratio of measured and triangulated depth at the features."""
    ratios = []
    for number, image in index.items():
        seen = [p for p in image.points2D if p.has_point3D()]
        if not seen:
            continue
        points = np.stack([model.points3D[p.point3D_id].xyz for p in seen])
        pose = image.cam_from_world().matrix()
        depth = points @ pose[2, :3] + pose[2, 3]
        measured = interpolate_depth(depths_m[number], np.stack([p.xy for p in seen]), 0.05)
        good = np.isfinite(measured) & (depth > 0)
        ratios.append(measured[good] / depth[good])
    joined = np.concatenate(ratios) if ratios else np.zeros(0)
    if len(joined) < 20:
        raise PlopError(
            "There is no depth where the scan has features.",
            expected="at least 20 measured features",
            found=f"{len(joined)}",
            fix='Use the robot\'s poses (scale_from="poses").',
        )
    return float(np.median(joined))


def interpolate_depth(depth_m: np.ndarray, pixels: np.ndarray, gate_m: float) -> np.ndarray:
    """Interpolate a depth image bilinearly, without bridging holes or edges.

    Args:
        depth_m: Shape [H, W], metres, 0 or NaN = not measured.
        pixels: Image coordinates, shape [N, 2]; pixel centres lie at half-integers.
        gate_m: Largest spread of the four neighbours [m].

    Returns:
        Depths, shape [N], metres; NaN where unknown.
    """
    height, width = depth_m.shape
    x, y = pixels[:, 0] - 0.5, pixels[:, 1] - 0.5
    inside = (x >= 0) & (y >= 0) & (x < width - 1) & (y < height - 1)
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    column, row = x.astype(int), y.astype(int)
    corners = np.stack(
        [depth_m[row, column], depth_m[row, column + 1], depth_m[row + 1, column], depth_m[row + 1, column + 1]]
    ).astype(np.float64)
    a, b = x - column, y - row
    value = (corners * np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b])).sum(0)
    good = inside & np.isfinite(corners).all(0) & (corners > 0).all(0) & (np.ptp(corners, axis=0) < gate_m)
    return np.where(good, value, np.nan)
