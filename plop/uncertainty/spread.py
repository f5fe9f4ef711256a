"""How far the models of an ensemble are apart, for every Gaussian of a rollout and for points among them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from plop.comparison.gaussian_lineage import average_around, follow_gaussians
from plop.gaussians.state import Gaussians


def ensemble_spread(first: Gaussians, now: Gaussians, members: Sequence[Gaussians]) -> np.ndarray:
    """Measure the spread of an ensemble around one of its predictions.

    It is the root mean square, over the other models and three coordinates, of their distance from this prediction;
    where the truth is like another model, it is also the standard deviation of the error of one coordinate.

    Args:
        first: Gaussians at the first frame; their lineage ids are unique.
        now: The prediction, a later state that descends from them.
        members: Predictions of the other models for the same frame, from the same first frame.

    Returns:
        Spread of one coordinate of each Gaussian of `now`, [N] [m]; splits share that of their ancestor.
    """
    start = first.means.detach().cpu().numpy().astype(float)
    own, *others = (follow_gaussians(first, each, start) for each in (now, *members))
    spread = np.sqrt(np.square(np.stack(others) - own).mean((0, 2)))
    ids = first.ids.cpu().numpy()
    order = np.argsort(ids)
    return np.asarray(spread[order[np.searchsorted(ids[order], now.ids.cpu().numpy())]])


def spread_at(first: Gaussians, now: Gaussians, spread: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Interpolate a spread to points, with the weights by which the Gaussians move them.

    Args:
        first: Gaussians at the first frame.
        now: A later state.
        spread: Spread of each Gaussian of it, [N] [m].
        points: Places at the first frame, [M, 3] [m].

    Returns:
        Shape [M] [m].
    """
    return average_around(first, now, spread[:, None], points)[:, 0]
