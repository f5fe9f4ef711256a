"""The unseen part of an object's footprint on a table."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from plop.geometry.view import View

_ABOVE_M = 0.003
"""Height above the table at which free space is tested [m]."""
_INWARDS_M = 0.0015
"""Margin inside the outline [m]: a camera that looks along the side sees past positions on the outline itself."""
_BEHIND_M = 0.002
"""A camera that measures further than this behind a place has seen through it [m]."""
_LOWER_PART = 0.5
"""Share of the object's height within which points may lie above a hidden part."""


def unseen_footprint(points: np.ndarray, views: Iterable[View], table_z_m: float) -> np.ndarray:
    """Extend an object's sides straight down to the table where no camera has seen free space.

    A tool or a hand in front of an object hides its lower edge; without this, the hull of the visible points
    has its corners cut off there.

    Args:
        points: Positions on the object's surface, [M, 3] [m].
        views: The measured views; a tool, or pixels labelled as undecided, may hide the object.
        table_z_m: Height of the table [m].

    Returns:
        Positions on the table, [K, 3] [m].
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
    """Return the positions that a camera sees through, [M] bool."""
    inside, row, column, depth = view.camera.pixels_of(places)
    measured = view.depth_without_tool_m[row, column]
    return np.asarray(inside & np.isfinite(measured) & (measured > depth + _BEHIND_M))
