"""Scores of segmentation masks, without unit, 1 is perfect.

Conventions: `j_score` is the intersection over union (the J of DAVIS). `f_score` is the
boundary F-measure of DAVIS (Perazzi et al., 2016): precision and recall of the predicted
contour, a contour pixel being right when the other contour passes within a tolerance of
0.8 % of the image diagonal, rounded up (2 px at 128x128).
Pixels to ignore count as background in both masks. A mask that is empty in the measurement
has no reference: both scores are undefined. An empty prediction of a measured
object scores 0.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

TOLERANCE_OF_DIAGONAL = 0.008
"""Tolerance of the boundary score, relative to the image diagonal."""


def j_score(predicted: np.ndarray, measured: np.ndarray) -> float | None:
    """Divide intersection by union; None when the measured mask is empty.

    Args:
        predicted: bool, shape [H, W].
        measured: bool, shape [H, W].
    """
    if not measured.any():
        return None
    return float((predicted & measured).sum() / (predicted | measured).sum())


def f_score(predicted: np.ndarray, measured: np.ndarray) -> float | None:
    """Compare the contours of two masks; None when the measured mask has no contour.

    Args:
        predicted: bool, shape [H, W].
        measured: bool, shape [H, W].

    Returns:
        Harmonic mean of the contour's precision and recall in [0, 1].
    """
    contour, truth = boundary(predicted), boundary(measured)
    if not truth.any():
        return None
    if not contour.any():
        return 0.0
    tolerance = np.ceil(TOLERANCE_OF_DIAGONAL * np.hypot(*measured.shape))
    precision = float((distance_transform_edt(~truth)[contour] <= tolerance).mean())
    recall = float((distance_transform_edt(~contour)[truth] <= tolerance).mean())
    return 0.0 if precision + recall == 0 else 2 * precision * recall / (precision + recall)


def boundary(mask: np.ndarray) -> np.ndarray:
    """Mark pixels that differ from the pixel to the right, below or diagonally below, bool, shape [H, W]."""
    padded = np.pad(mask, ((0, 1), (0, 1)), mode="edge")
    right, below, diagonal = padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]
    return np.asarray((mask != right) | (mask != below) | (mask != diagonal))
