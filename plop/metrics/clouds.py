"""The clouds that CD, EMD and HD compare: depth images of all cameras, back-projected.

The measured cloud is the measured depth on the measured object mask; the predicted cloud is
the rendered depth on the rendered object mask, through the same cameras (PLOP, Sec. IV-C).
Only what the cameras see is compared, and a surface counts once per pixel that sees it.

EMD needs two samples of equal size. Drawn independently, two samples of the *same* surface
already lie a few millimetres apart (the sampling floor). Here both are drawn with common
random numbers: every pixel of every camera has one fixed random priority, and each cloud
gives its valid pixels of lowest priority. Each sample alone is a uniform draw without
replacement from its cloud, so both estimates tend to the same limit as the samples grow;
but where the clouds agree they choose the same pixels, so identical clouds score exactly 0
and the noise of similar clouds cancels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plop.geometry.view import View


@dataclass(frozen=True)
class Cloud:
    """Back-projected pixels of all cameras."""

    points: np.ndarray
    """Shape [N, 3], world frame [m]."""
    priority: np.ndarray
    """Random number in [0, 1) of the pixel that each point comes from, shape [N]."""

    def __len__(self) -> int:
        return len(self.points)


def pixel_priorities(camera_index: int, height: int, width: int, seed: int) -> np.ndarray:
    """Draw the fixed random priority of every pixel of one camera, shape [H, W], in [0, 1)."""
    return np.random.default_rng([seed, camera_index]).random((height, width))


def back_project_all(views: Sequence[View], known: Sequence[np.ndarray] | None = None, *, seed: int = 0) -> Cloud:
    """Collect the object's pixels of all cameras into one cloud.

    Args:
        views: One of each camera; their order fixes the priorities. Depth that is 0 or NaN is not measured.
        known: Pixels of each that count, bool, shape [H, W]; all when absent.
        seed: Seed of the priorities.

    Returns:
        The cloud; empty when no pixel is valid.
    """
    points, priority = [np.zeros((0, 3))], [np.zeros(0)]
    for index, view in enumerate(views):
        depth = view.depth_m
        use = view.object_mask & np.isfinite(depth) & (depth > 0)
        use = use if known is None else use & known[index]
        points.append(view.camera.back_project(depth, use))
        priority.append(pixel_priorities(index, depth.shape[0], depth.shape[1], seed)[use])
    return Cloud(np.concatenate(points), np.concatenate(priority))


def paired_samples(cloud_a: Cloud, cloud_b: Cloud, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw equally large samples of two clouds with common random numbers.

    Args:
        cloud_a: One cloud.
        cloud_b: The other.
        count: Points wanted; fewer come back when a cloud is smaller.

    Returns:
        Two arrays of shape [min(count, A, B), 3], metres.
    """
    size = min(count, len(cloud_a), len(cloud_b))

    def lowest(cloud: Cloud) -> np.ndarray:
        return cloud.points[np.argsort(cloud.priority, kind="stable")[:size]]

    return lowest(cloud_a), lowest(cloud_b)
