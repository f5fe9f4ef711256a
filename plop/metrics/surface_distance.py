"""Distance of the predicted surface from the measured one, at every pixel of one camera, for pictures.

As in the scores (CD), distance goes from a measured point to the nearest predicted one that any camera sees, so
that a step in depth at an outline is not an error of its own. Where only the prediction shows the object the
distance is that of the predicted point to the nearest measured one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from plop.geometry.view import MaskLabel, View

MOST_POINTS = 40_000
"""Largest number of points of a cloud; larger images are subsampled to every second, third, ... row and column."""


def distance_map_mm(
    measured: Sequence[View], predicted: Sequence[View], place: int, rows: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """Measure the distance between two surfaces at some pixels of one camera.

    Args:
        measured: What each camera saw.
        predicted: What each would have seen, in the same order.
        place: Which of them the map is of.
        rows: Rows to take, int, shape [h].
        columns: Columns to take, int, shape [w].

    Returns:
        Distance [mm], float32, shape [h, w]; NaN where neither shows the object, where the measurement shows the tool
        or an undecided label, where depth was not measured, or where the other surface is absent.
    """
    picked = np.ix_(rows, columns)
    seen, drawn = measured[place], predicted[place]
    ours, theirs = seen.object_mask[picked], drawn.object_mask[picked]
    only_drawn = theirs & (seen.mask[picked] == MaskLabel.BACKGROUND)
    out = np.full(ours.shape, np.nan, np.float32)
    for where, view, others in ((ours, seen, predicted), (only_drawn, drawn, measured)):
        points, known = _points(view, rows, columns, where)
        cloud = _cloud(others)
        if len(points) and len(cloud):
            out[known] = 1000 * cKDTree(cloud).query(points)[0]
    # The surface on the pixel's own ray is a point of the other surface, too: equal depth is distance 0 although the
    # clouds are thinned.
    along = 1000 * np.abs(seen.depth_m[picked] - drawn.depth_m[picked]) * _ray_lengths(seen, rows, columns)
    both = ours & theirs & _is_depth(seen.depth_m[picked]) & _is_depth(drawn.depth_m[picked])
    out[both] = np.fmin(out[both], along[both])
    return out


def scale_end_mm(maps: Iterable[np.ndarray], footprint_mm: float) -> float:
    """Choose a round number for the end of a colour scale that all maps share.

    Args:
        maps: Distances [mm], NaN where there is none.
        footprint_mm: Size of a pixel on the object [mm]: smaller distances are not resolved, so the scale is no finer.

    Returns:
        The least of ..., 1, 2, 5, 10, ... that is not below all but 2 % of the distances: a few pixels at outlines
        must not compress the scale for all others [mm].
    """
    known = [found[np.isfinite(found)] for found in maps]
    values = np.concatenate(known) if known else np.zeros(0)
    least = max(float(np.percentile(values, 98)) if len(values) else 0.0, footprint_mm, 1e-3)
    steps = [digit * 10.0**power for power in range(-3, 7) for digit in (1, 2, 5)]
    return next((step for step in steps if step >= least * (1 - 1e-9)), steps[-1])


def _is_depth(depth_m: np.ndarray) -> np.ndarray:
    return np.asarray(np.isfinite(depth_m) & (depth_m > 0))


def _points(view: View, rows: np.ndarray, columns: np.ndarray, where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Back-project chosen pixels; return points [N, 3] and their pixels on the grid, bool [h, w]."""
    known = where & _is_depth(view.depth_m[np.ix_(rows, columns)])
    full = np.zeros(view.depth_m.shape, bool)
    full[np.ix_(rows, columns)] = known
    return view.camera.back_project(view.depth_m, full), known


def _cloud(views: Sequence[View]) -> np.ndarray:
    masks = [view.object_mask & _is_depth(view.depth_m) for view in views]
    step = max(1, int(np.ceil(np.sqrt(sum(int(mask.sum()) for mask in masks) / MOST_POINTS))))
    points = []
    for view, mask in zip(views, masks, strict=True):
        thinned = np.zeros_like(mask)
        thinned[::step, ::step] = mask[::step, ::step]
        points.append(view.camera.back_project(view.depth_m, thinned))
    return np.concatenate(points) if points else np.zeros((0, 3))


def _ray_lengths(view: View, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Length of rays a metre deep, shape [h, w]."""
    directions = view.camera.directions(*np.meshgrid(columns + 0.5, rows + 0.5))
    return np.asarray(np.linalg.norm(directions, axis=-1))
