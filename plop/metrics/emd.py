"""Earth mover's distance between two equally large samples of point clouds, in millimetres.

Convention: the one-to-one matching with the smallest sum of Euclidean distances (exact, by
scipy's `linear_sum_assignment`), then the mean matched distance. Samples have 1024 points
(PLOP, Sec. IV-C); how they are drawn is in `plop.metrics.clouds`.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from plop.metrics.chamfer import MM_PER_M

EMD_POINTS = 1024
"""Points of each sample."""


def emd_mm(sample_a: np.ndarray, sample_b: np.ndarray) -> float | None:
    """Match two samples one to one and average the matched distance.

    Releases the interpreter lock while it matches, so threads run in parallel.

    Args:
        sample_a: Shape [N, 3], metres.
        sample_b: Shape [N, 3], metres.

    Returns:
        Mean matched distance in millimetres, or None when the samples are empty.

    Raises:
        ValueError: The samples differ in size.
    """
    if len(sample_a) != len(sample_b):
        raise ValueError(f"samples of equal size expected, found {len(sample_a)} and {len(sample_b)} points")
    if len(sample_a) == 0:
        return None
    cost = cdist(sample_a, sample_b)
    return float(cost[linear_sum_assignment(cost)].mean() * MM_PER_M)
