"""Where a fit begins: the best minimum near the likeliest of some draws of the prior, on a coarse grid.

The error has many minima, since an object slips on the table or under the tool or sticks, and a stiffness that is best
with a wrong friction is far from the best. Which minimum a descent ends in depends on where it begins, and the
likeliest draw need not lie near the best one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from joblib import Parallel, delayed
from scipy.stats import norm, qmc

from plop.compute.workers import workers
from plop.errors import PlopError
from plop.identification.tracked_case import TrackedCase, mean_square
from plop.physics.calibration.gauss_newton import minimum_near
from plop.physics.calibration.posterior import Posterior
from plop.physics.engine.material import Material

DRAWS = 16
"""Points of a Sobol sequence, a power of two; the first one is the mean of the prior."""
STARTS = 4
"""Draws from which a descent begins."""
_GAIN = 0.2
"""What a step of these has to promise [nats]: they only tell minima apart. A standard deviation costs a half."""


def best_start(
    cases: Sequence[TrackedCase], start: Material, posterior: Posterior, iterations: int, jobs: int
) -> tuple[Material, int]:
    """Go downhill from the likeliest of some draws of the prior.

    Args:
        cases: Episodes, on a coarse grid.
        start: What is not drawn.
        posterior: The prior, and how likely a draw is.
        iterations: Most Gauss-Newton steps of each descent.
        jobs: Processes.

    Returns:
        The best minimum, and the number of engine runs.
    """
    likely, runs = likeliest_draws(cases, start, posterior, jobs)
    config = cases[0].base.config
    near = (delayed(minimum_near)(cases, draw, posterior, config, iterations, _GAIN) for draw in likely)
    with workers():
        ends = Parallel(n_jobs=jobs)(near)
    return min(ends, key=lambda end: end[0])[1], runs + sum(end[2] for end in ends)


def likeliest_draws(
    cases: Sequence[TrackedCase], start: Material, posterior: Posterior, jobs: int
) -> tuple[list[Material], int]:
    """Simulate some draws of the prior: the likeliest STARTS of them, and the number of engine runs."""
    away = norm.ppf(qmc.Sobol(len(posterior.parameters), seed=0).random(DRAWS))
    away[0] = 0
    drawn = [posterior.material(start, row) for row in posterior.center + posterior.deviations * away]
    trials = [replace(case, base=replace(case.base, material=material)) for material in drawn for case in cases]
    with workers():
        squares = Parallel(n_jobs=jobs)(delayed(_square)(trial) for trial in trials)
    costs = [
        posterior.cost(posterior.coordinates(material), row)
        for material, row in zip(drawn, np.reshape(squares, (DRAWS, -1)), strict=True)
    ]
    return [drawn[k] for k in np.argsort(costs)[:STARTS]], len(trials)


def _square(case: TrackedCase) -> float:
    try:
        return mean_square(case)
    except PlopError:  # unstable: the fit says so if all are
        return np.inf
