"""What one measured view says about points of a surface: whether it contradicts them, and what it saw there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion, distance_transform_edt, map_coordinates, minimum_filter

from plop.geometry.view import MaskLabel, View

_OUTSIDE = 0.05
"""Of a mask of 0 and 1 between pixel centres: below, a point lies beyond the object's outline."""
_MIXED = 1e-3
"""Weight of a colour on an outline: that of the pixel within, for places that no view sees any better."""
_ON_IT_PX = 0.1
"""Widths of a pixel between a point and the measured surface within which it lies on it."""
_FACING = (0.02, 0.1)
"""Least cosines between surface and line of sight that count, for colours and for the width of a pixel."""


class Said(NamedTuple):
    """What a view says about N points."""

    wrong: np.ndarray
    """It sees past them or through them, bool [N]."""
    colour: np.ndarray
    """What it saw there, [N, 3], 0..255."""
    weight: np.ndarray
    """Of the colour, [N]; 0 where it does not see them."""
    beyond_m: np.ndarray
    """How far they lie beyond the middle of the outermost pixel that shows the object, along the surface, [N] [m]; 0
    for what it sees on the object, infinite elsewhere away from the outline and where something hides them."""
    before_m: np.ndarray
    """How far they lie before the middle of the first pixel that does not, [N] [m]; infinite away from it."""


@dataclass(frozen=True)
class Sight:
    """One view, ready to say what it shows at a point."""

    view: View
    rgb: np.ndarray
    """Colour of the object with nothing beside it mixed in, [H, W, 3], 0..255."""
    near_m: np.ndarray
    """Least depth of the object in each pixel and its neighbours, [H, W] [m]; 0 where there is none."""
    possible: np.ndarray
    """1 where the object may be, 0 where the background shows, [H, W]."""
    pure: np.ndarray
    """1 where the object shows, [H, W]."""

    @classmethod
    def of(cls, view: View) -> Sight:
        """Prepare a view."""
        near = minimum_filter(np.where(view.object_mask & (view.depth_m > 0), view.depth_m, np.inf), 3)
        possible, pure = (mask.astype(np.float64) for mask in (view.mask != MaskLabel.BACKGROUND, view.object_mask))
        return cls(view, _unmixed(view), np.where(np.isinf(near), 0, near), possible, pure)

    def about(self, points: np.ndarray, normals: np.ndarray, tolerance_m: float) -> Said:
        """Look at points [N, 3] [m] of a surface with normals [N, 3]; depths differ by more than the tolerance [m]."""
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
    """Give pixels that border on something else the colour of the nearest that does not, [H, W, 3], 0..255.

    On an outline a camera sees object and background mixed. Where all views see an outline, as at the foot of an
    object on its table, that mixture would pass for the surface's own colour.
    """
    rgb = view.rgb.astype(np.float64)
    within = binary_erosion(view.object_mask, border_value=1)
    if not within.any():
        return rgb
    rows, columns = distance_transform_edt(~within, return_distances=False, return_indices=True)
    return rgb[rows, columns]
