"""A first guess in the right valley of the error.

Pushed or dragged, an object slips on the table or under the tool, and the error has a valley for each: which one a
descent ends in depends on where it begins. So a grid of guesses is tried first, on a coarse grid of the engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from plop.compute.workers import workers
from plop.errors import PlopError
from plop.identification.tracked_case import TrackedCase, mean_square
from plop.physics.calibration.gauss_newton import PARAMETERS
from plop.physics.engine.material import Material

FACTORS = {"youngs_modulus_pa": 1.6, "table_friction": 1.5, "tool_friction": 1.5}
"""Parameters that decide where an object slips, and by how much more and less of them is tried."""


def best_guess(cases: Sequence[TrackedCase], start: Material, names: Sequence[str], jobs: int) -> tuple[Material, int]:
    """Vary the parameters that decide where an object slips; the rest, and what is not fitted, stays.

    Args:
        cases: Episodes, on a coarse grid.
        start: The guess in the middle.
        names: Parameters that are fitted.
        jobs: Processes.

    Returns:
        The guess with the smallest squared error, and the number of engine runs.
    """
    varied = [name for name in FACTORS if name in names]
    if not varied:
        return start, 0
    choices = [
        [float(np.clip(f * getattr(start, n), PARAMETERS[n].low, PARAMETERS[n].high)) for f in (1, 1 / most, most)]
        for n, most in FACTORS.items()
        if n in varied
    ]
    combined: list[dict[str, Any]] = [dict(zip(varied, v, strict=True)) for v in dict.fromkeys(product(*choices))]
    guesses = [replace(start, **values) for values in combined]
    trials = [replace(case, base=replace(case.base, material=guess)) for guess in guesses for case in cases]
    with workers():
        squares = Parallel(n_jobs=jobs)(delayed(_error)(trial) for trial in trials)
    return guesses[int(np.argmin(np.reshape(squares, (len(guesses), -1)).sum(1)))], len(trials)


def _error(case: TrackedCase) -> float:
    try:
        return mean_square(case)
    except PlopError:  # unstable: the fit says so if all are
        return np.inf
