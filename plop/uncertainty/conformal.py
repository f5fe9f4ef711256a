"""Conformal quantile of scores that come in groups: episodes are exchangeable, the points of one are not independent.

Every group has the same weight 1 / (K + 1), shared among its scores, and the remaining weight lies at infinity: the
quantile of this distribution is above a random score of a new group with the wanted probability (hierarchical
conformal prediction: Lee, Barber and Willett 2023, arXiv:2306.06342). Below `least_groups` it is
infinite; the quantile without the infinite weight (CDF pooling: Dunn, Wasserman and Ramdas 2022,
arXiv:1809.07441) has no finite-sample guarantee.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np


def least_groups(level: float) -> int:
    """Return the smallest number of groups whose quantile at a level is finite: 9 for 0.9."""
    return ceil(level / (1 - level) - 1e-9)


def group_quantile(scores: Sequence[np.ndarray], level: float) -> tuple[float, bool]:
    """Return the conformal quantile of grouped scores.

    Args:
        scores: Scores of each group, any number each; groups without a score are left out.
        level: Wanted probability, in (0, 1).

    Returns:
        The quantile, and whether its coverage is guaranteed; without enough groups it is that of the pooled scores.

    Raises:
        ValueError: There is no score.
    """
    groups = [np.ravel(each) for each in scores if np.size(each)]
    values = np.concatenate(groups)
    weights = np.concatenate([np.full(len(each), 1 / (len(groups) * len(each))) for each in groups])
    guaranteed = len(groups) >= least_groups(level)
    wanted = level * (len(groups) + 1) / len(groups) if guaranteed else level
    order = np.argsort(values)
    place = int(np.searchsorted(np.cumsum(weights[order]), wanted - 1e-9))
    return float(values[order[min(place, len(order) - 1)]]), guaranteed
