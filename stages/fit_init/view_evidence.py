"""Evidence of one measured view on points of a surface: contradictions and colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion, distance_transform_edt, map_coordinates, minimum_filter

from plop.geometry.view import MaskLabel, View

_OUTSIDE = 0.05
"""Threshold of an interpolated mask: below, a point lies outside the object's outline."""
_MIXED = 1e-3
"""Weight of a colour on an outline, taken from the inner pixel, for positions that no view sees better."""
_ON_IT_PX = 0.1
"""Largest distance of a point on the measured surface, in widths of a pixel."""
_FACING = (0.02, 0.1)
"""Smallest cosines between surface and line of sight, for colours and for the width of a pixel."""


class Said(NamedTuple):
    """Evidence of a view on N points."""

    wrong: np.ndarray
    """Whether it sees past them or through them, bool [N]."""
    colour: np.ndarray
    """Colour seen there, [N, 3], 0..255."""
    weight: np.ndarray
    """Weight of the colour, [N]; 0 where it does not see them."""
    beyond_m: np.ndarray
    """Distance beyond the middle of the outermost pixel of the object, along the surface, [N] [m]; 0 for points seen on
    the object, infinite elsewhere away from the outline and where they are hidden."""
    before_m: np.ndarray
    """Distance before the middle of the first pixel outside the object, [N] [m]; infinite away from it."""


@dataclass(frozen=True)
class ViewEvidence:
    """One view, prepared for queries at points."""

    view: View
    rgb: np.ndarray
    """Colour of the object without mixed pixels, [H, W, 3], 0..255."""
    near_m: np.ndarray
    """Smallest depth of the object in each pixel and its neighbours, [H, W] [m]; 0 where there is none."""
    possible: np.ndarray
    """1 where the object may be, 0 where the background is visible, [H, W]."""
    pure: np.ndarray
    """1 where the object is visible, [H, W]."""

    @classmethod
    def of(cls, view: View) -> ViewEvidence:
        """Prepare a view."""
        near = minimum_filter(np.where(view.object_mask & (view.depth_m > 0), view.depth_m, np.inf), 3)
        possible, pure = (mask.astype(np.float64) for mask in (view.mask != MaskLabel.BACKGROUND, view.object_mask))
        return cls(view, _unmixed(view), np.where(np.isinf(near), 0, near), possible, pure)

    def about(self, points: np.ndarray, normals: np.ndarray, tolerance_m: float) -> Said:
        """Evaluate points [N, 3] [m] of a surface with normals [N, 3] and a tolerance of their depth [m]."""
        camera = self.view.camera
        pixel, depth = camera.project(points)
        place = (pixel - 0.5).T[::-1]
        row, column = np.clip(
            np.floor(np.clip(pixel.T[::-1], -1e6, 1e6)), 0, [[camera.height - 1], [camera.width - 1]]
        ).astype(int)
        inside = (np.abs(pixel / [camera.width, camera.height] - 0.5) < 0.5).all(1) & (depth > 0)
        images = (self.possible, self.pure, self.view.depth_m, *np.moveaxis(self.rgb, 2, 0))
        covered, pure, surface_m, *colour = (map_coordinates(image, place, order=1, mode="nearest") for image in images)
        through = depth < self.near_m[row, column] - tolerance_m
        seen = inside & self.view.object_mask[row, column]
        seen &= np.abs(self.view.depth_m[row, column] - depth) < tolerance_m
        toward = camera.world_from_cam[:3, 3] - points
        facing = (toward * normals).sum(1) / np.linalg.norm(toward, axis=1)
        weight = seen * np.clip(facing, _FACING[0], 1) ** 3 * np.where(pure < 0.99, _MIXED, 1.0)
        pixel_m = depth / (camera.intrinsics[0, 0] * np.clip(np.abs(facing), _FACING[1], 1))
        outline = inside & ~through & (covered < 1)
        beyond_m = np.where(outline & seen, (1 - covered) * pixel_m, np.inf)
        beyond_m[seen & (pure == 1) & (np.abs(surface_m - depth) < _ON_IT_PX * pixel_m)] = 0
        return Said(
            inside & ((covered < _OUTSIDE) | through),
            np.stack(colour, axis=1),
            weight,
            beyond_m,
            np.where(outline, covered * pixel_m, np.inf),
        )


def _unmixed(view: View) -> np.ndarray:
    """Replace the colour of pixels on the outline by that of the nearest inner pixel, [H, W, 3], 0..255.

    On an outline a pixel mixes object and background. Where all views see an outline, as at the foot of an
    object on its table, the mixture would be taken as the surface's own colour.
    """
    rgb = view.rgb.astype(np.float64)
    within = binary_erosion(view.object_mask, border_value=1)
    if not within.any():
        return rgb
    rows, columns = distance_transform_edt(~within, return_distances=False, return_indices=True)
    return rgb[rows, columns]
