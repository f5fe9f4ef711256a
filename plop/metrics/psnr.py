"""Peak signal-to-noise ratio, in decibels.

Convention: images are floats in [0, 1], peak 1, mean squared error over all pixels and
channels. Identical images have no finite ratio: the error is floored at 1e-10, so that a
perfect image scores exactly 100 dB.
"""

from __future__ import annotations

import numpy as np

PERFECT_DB = 100.0
"""Score of identical images [dB]."""


def psnr_db(image: np.ndarray, reference: np.ndarray) -> float:
    """Compare two images.

    Args:
        image: Shape [H, W, 3], float, 0..1.
        reference: Same shape.

    Returns:
        Ratio in dB, at most `PERFECT_DB`.
    """
    error = float(np.square(image.astype(np.float64) - reference).mean())
    return float(min(PERFECT_DB, -10 * np.log10(max(error, 1e-10))))
