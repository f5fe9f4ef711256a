"""The paper's crop: 2D scores see only the bounding box of the union of both object masks."""

from __future__ import annotations

import numpy as np


def union_box(mask_a: np.ndarray, mask_b: np.ndarray, *, min_side_px: int = 1) -> tuple[slice, slice] | None:
    """Find the bounding box of the union of two masks (PLOP, Sec. IV-C).

    Args:
        mask_a: bool, shape [H, W].
        mask_b: bool, shape [H, W].
        min_side_px: A smaller side is widened to this, as far as the image reaches [px].

    Returns:
        Slices (rows, columns), or None when both masks are empty.
    """
    union = mask_a | mask_b
    if not union.any():
        return None
    rows, columns = (np.flatnonzero(union.any(axis=axis)) for axis in (1, 0))
    height, width = union.shape
    return _widen(rows, height, min_side_px), _widen(columns, width, min_side_px)


def _widen(used: np.ndarray, limit: int, least: int) -> slice:
    start, stop = int(used[0]), int(used[-1]) + 1
    missing = max(0, min(least, limit) - (stop - start))
    start = max(0, min(start - missing // 2, limit - (stop - start) - missing))
    return slice(start, max(stop, start + min(least, limit)))
