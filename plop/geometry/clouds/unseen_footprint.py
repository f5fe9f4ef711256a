"""Where an object may stand on a table, although no camera has seen it there."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from plop.geometry.view import View

_ABOVE_M = 0.003
"""How far above the table it is looked whether something could be [m]."""
_INWARDS_M = 0.0015
"""How far within the outline [m]: a place on it is seen past by a camera that looks along the side."""
_BEHIND_M = 0.002
"""A camera that measures further than this behind a place has seen through it [m]."""
_LOWER_PART = 0.5
"""Share of the height in which points may stand above something hidden."""


def hidden_below(points: np.ndarray, views: Iterable[View], table_z_m: float) -> np.ndarray:
    """Continue an object's sides straight down to the table where no camera sees that nothing is there.

    What stands in front of an object (a tool, a hand) hides its lower edge; without this, what is wrapped around
    the points that are seen has its corners cut off there.

    Args:
        points: Places on the object's surface, [M, 3] [m].
        views: What the cameras measured; a tool, or what is undecided, may hide the object.
        table_z_m: Height of the table [m].

    Returns:
        Places on the table, [K, 3] [m].
    """
    height = float(points[:, 2].max()) - table_z_m
    low = points[points[:, 2] < table_z_m + _LOWER_PART * height]
    outwards = low[:, :2] - points[:, :2].mean(0)
    outwards /= np.maximum(np.linalg.norm(outwards, axis=1, keepdims=True), 1e-9)
    places = np.column_stack([low[:, :2] - _INWARDS_M * outwards, np.full(len(low), table_z_m + _ABOVE_M)])
    hidden = np.ones(len(low), bool)
    for view in views:
        hidden &= ~_seen_through(places, view)
    return np.column_stack([low[hidden, :2], np.full(int(hidden.sum()), table_z_m)])


def _seen_through(places: np.ndarray, view: View) -> np.ndarray:
    """Tell which places a camera sees something behind of, [M] bool."""
    inside, row, column, depth = view.camera.pixels_of(places)
    measured = view.depth_without_tool_m[row, column]
    return np.asarray(inside & np.isfinite(measured) & (measured > depth + _BEHIND_M))
