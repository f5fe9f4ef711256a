"""Show a part of a recorded image, enlarged and smoothed.

Recorded images are interpolated between pixels. Values known only at some pixels (a distance on an object) are
interpolated among these, and the outline of a mask is smoothed by about a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from plop.geometry.cameras import Camera

_MARGIN = 0.12
"""Margin around the object, as a share of its box's longer side."""
_LEAST_SIDE = 0.75
"""Shorter side of a part, as a share of the longer, where the image allows: a strip is hard to read."""
_LEAST_PX = 24
"""Smallest side of a part [px of the recording], where the image allows."""
_SMOOTH_PX, _THIN_PX = 1.3, 0.45
"""Smoothing of outlines [px of the recording]: the first removes the steps of pixels; the second, for structures one
pixel wide, leaves a line of one pixel."""


@dataclass(frozen=True)
class Crop:
    """A part of a camera's image, and the size at which it is shown."""

    top: int
    left: int
    rows: int
    """Height of the part [px of the recording]."""
    columns: int
    """Its width."""
    size: tuple[int, int]
    """(height, width) of the displayed picture [px]."""

    @classmethod
    def around(cls, masks: Sequence[np.ndarray], long_px: int) -> Crop:
        """Return the part of an image that contains some masks, with a margin.

        Args:
            masks: At least one, bool, shape [H, W]; if all are empty, the whole image is taken.
            long_px: Longer side of the displayed picture [px].
        """
        limit = np.array(masks[0].shape)
        boxes = [box for box in map(_box, masks) if box is not None]
        low, high = np.zeros(2), limit.astype(float)
        if boxes:
            low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
        size = np.maximum(high - low + 2 * np.ceil(_MARGIN * (high - low).max()), _LEAST_PX)
        size = np.minimum(np.maximum(size, np.ceil(_LEAST_SIDE * size.max())), limit)
        start = np.clip(np.floor((low + high - size) / 2), 0, limit - size)
        rows, columns = (int(value) for value in size)
        shown = np.maximum(np.round(size * long_px / size.max()), 2)
        return cls(int(start[0]), int(start[1]), rows, columns, (int(shown[0]), int(shown[1])))

    def camera(self, camera: Camera) -> Camera:
        """Return a camera at the same pose that renders only this part, at the displayed size."""
        matrix = camera.intrinsics.copy()
        matrix[:2, 2] -= [self.left, self.top]
        cut = Camera(camera.name, self.columns, self.rows, matrix, camera.world_from_cam)
        return cut.resized(self.size[1], self.size[0])

    def of(self, image: np.ndarray) -> np.ndarray:
        """Crop an image to the part, shape [H, W, ...]."""
        return image[self.top : self.top + self.rows, self.left : self.left + self.columns]

    def step(self, most_px: int) -> int:
        """Return the step of a subsampling with at most a given number of pixels along a side."""
        return -(-max(self.rows, self.columns) // most_px)

    def grid(self, most_px: int) -> tuple[np.ndarray, np.ndarray]:
        """Return rows and columns, evenly spread over the part, at most a given number along a side."""
        step = self.step(most_px)
        return (
            self.top + np.arange(min(step // 2, self.rows - 1), self.rows, step),
            self.left + np.arange(min(step // 2, self.columns - 1), self.columns, step),
        )


def enlarged_mask(mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Enlarge a mask smoothly.

    Args:
        mask: Bool, shape [h, w].
        size: New (height, width).

    Returns:
        Share of every pixel that is covered, float32, shape [height, width], 0..1.
    """
    if not mask.any() or mask.all():
        return np.full(size, float(mask.any()), np.float32)
    inside = _depth_inside(mask, _SMOOTH_PX)
    thin = mask & (cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)) == 0)
    if thin.any():
        inside = np.where(thin, np.maximum(inside, _depth_inside(mask, _THIN_PX)), inside)
    # A ramp of one displayed pixel.
    return np.asarray(np.clip(resized(inside, size) * max(size[0] / mask.shape[0], 1.0) + 0.5, 0, 1))


def enlarged(values: np.ndarray, known: np.ndarray, size: tuple[int, int], *, smooth_px: float) -> np.ndarray:
    """Enlarge values known at some pixels, without influence of the others.

    Args:
        values: Shape [h, w].
        known: Valid pixels, bool, shape [h, w].
        size: New (height, width).
        smooth_px: Standard deviation of the smoothing [px before].

    Returns:
        Float32, shape [height, width]; the nearest known value beyond them, zero where none is known.
    """
    if not known.any():
        return np.zeros(size, np.float32)
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled = cv2.GaussianBlur(
        values[tuple(nearest)].astype(np.float32), (0, 0), smooth_px, borderType=cv2.BORDER_REPLICATE
    )
    return np.asarray(np.clip(resized(filled, size), filled.min(), filled.max()))


def laid_over(picture: np.ndarray, upper: np.ndarray, cover: np.ndarray) -> np.ndarray:
    """Blend a colour or a picture [H, W, 3] over another with the opacity `cover` [H, W], 0..1."""
    return np.asarray(picture + cover[..., None] * (upper - picture))


def resized(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Resize an image, float32 [h, w] or [h, w, C], to (height, width), smoothly."""
    smaller = size[0] < image.shape[0]
    return np.asarray(cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC))


def _depth_inside(mask: np.ndarray, smooth_px: float) -> np.ndarray:
    """Return the distance from the outline, positive inside, up to 3 px, smoothed; float32, shape [h, w] [px]."""
    inside, outside = (
        cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for part in (mask, ~mask)
    )
    # Pixel centres are half a pixel from the outline between them.
    signed = np.clip(np.where(mask, inside - 0.5, 0.5 - outside), -3, 3).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(signed, (0, 0), smooth_px, borderType=cv2.BORDER_REPLICATE))


def _box(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return first and end (row, column) of a mask; None when it is empty."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return (np.array([rows[0], columns[0]]), np.array([rows[-1], columns[-1]]) + 1) if len(rows) else None
