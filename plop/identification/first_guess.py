"""A first guess of the stiffness, which is known least: soft objects differ by orders of magnitude.

The error has more than one minimum, since an object slips on the table or under the tool, and which of them a descent
ends in depends on where it begins. Frictions begin where the user says: another engine's errors can make
a wrong valley of theirs the deeper one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from joblib import Parallel, delayed

from plop.compute.workers import workers
from plop.errors import PlopError
from plop.identification.tracked_case import TrackedCase, mean_square
from plop.physics.calibration.gauss_newton import PARAMETERS
from plop.physics.engine.material import Material

FACTOR, STEPS = 1.6, 4
"""Ratio of one stiffness that is tried to the next [-], and how many are tried on either side of the guess."""


def stiffness_first(cases: Sequence[TrackedCase], start: Material, jobs: int) -> tuple[Material, int]:
    """Vary the stiffness alone over a factor of six to either side of a guess.

    Args:
        cases: Episodes, on a coarse grid.
        start: The guess.
        jobs: Processes.

    Returns:
        The guess with the stiffness of least squared error, and the number of engine runs.
    """
    bounds = PARAMETERS["youngs_modulus_pa"]
    tried = start.youngs_modulus_pa * FACTOR ** np.array([0, *range(-STEPS, 0), *range(1, STEPS + 1)])
    guesses = [replace(start, youngs_modulus_pa=float(np.clip(modulus, bounds.low, bounds.high))) for modulus in tried]
    trials = [replace(case, base=replace(case.base, material=guess)) for guess in guesses for case in cases]
    with workers():
        squares = Parallel(n_jobs=jobs)(delayed(_square)(trial) for trial in trials)
    return guesses[int(np.argmin(np.reshape(squares, (len(guesses), -1)).sum(1)))], len(trials)


def _square(case: TrackedCase) -> float:
    try:
        return mean_square(case)
    except PlopError:  # unstable: the fit says so if all are
        return np.inf
