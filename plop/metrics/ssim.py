"""Structural similarity (Wang et al., 2004), without unit, 1 is perfect.

Convention: floats in [0, 1], Gaussian window of 11x11 px with sigma 1.5 px, K1 = 0.01,
K2 = 0.03, population covariance; per channel, then the mean over channels and over the
pixels whose window lies inside the image.

No library, since those that have it as a metric (scikit-image, torchmetrics) are large dependencies for twenty
lines; tests/metrics/test_image_scores.py compares it with scikit-image's.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import correlate1d

WINDOW_PX = 11
"""Smallest image side that has a score [px]."""
_SIGMA_PX, _C1, _C2 = 1.5, 0.01**2, 0.03**2


def ssim(image: np.ndarray, reference: np.ndarray) -> float | None:
    """Compare two images.

    Args:
        image: Shape [H, W, C], float, 0..1.
        reference: Same shape.

    Returns:
        Similarity in [-1, 1], or None when a side is shorter than the window.
    """
    if min(image.shape[:2]) < WINDOW_PX:
        return None
    x, y = image.astype(np.float64), reference.astype(np.float64)
    mean_x, mean_y = _blur(x), _blur(y)
    var_x, var_y = _blur(x * x) - mean_x**2, _blur(y * y) - mean_y**2
    cov = _blur(x * y) - mean_x * mean_y
    top = (2 * mean_x * mean_y + _C1) * (2 * cov + _C2)
    bottom = (mean_x**2 + mean_y**2 + _C1) * (var_x + var_y + _C2)
    edge = WINDOW_PX // 2
    return float((top / bottom)[edge:-edge, edge:-edge].mean())


def _blur(image: np.ndarray) -> np.ndarray:
    offsets = np.arange(WINDOW_PX) - WINDOW_PX // 2
    weights = np.exp(-0.5 * (offsets / _SIGMA_PX) ** 2)
    weights /= weights.sum()
    return np.asarray(correlate1d(correlate1d(image, weights, axis=0), weights, axis=1))
