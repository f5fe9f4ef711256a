"""Fit the engine's material to tracked episodes, so that it can stand in for the real object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from plop.comparison.engine_run import predict_points, start_particles
from plop.errors import PlopError
from plop.identification.first_guess import best_start
from plop.identification.tracked_case import SlopeCase, TrackedCase
from plop.physics.adapters.filled import EngineBase
from plop.physics.calibration.gauss_newton import Calibration, calibrate
from plop.physics.calibration.material_parameters import PARAMETERS
from plop.physics.calibration.posterior import Posterior
from plop.tracking.episode import Episode

PARTICLES = 1300
"""Particles that fill the object unless a spacing is given: with half as many, laws that act where the object bends
or is cut respond with a cosine of 0.7 to the true response instead of 0.85 (docs/results/parts.md)."""
COARSER = 1.4
"""Distance of the particles with which derivatives are taken, in units of the engine's own: a quarter of the time."""
NAMES = ("youngs_modulus_pa", "damping_per_s", "table_friction", "tool_friction", "table_slip_m_s")
"""Parameters that are fitted unless others are named."""


def starts_settled(episodes: list[Episode], base: EngineBase) -> bool:
    """Tell whether objects carried their own weight before the first frame, by which start follows them better."""
    errors = []
    for settled in (True, False):
        trial = replace(base, settled=settled)
        squares = []
        for episode in episodes:
            points = predict_points(trial, episode, start_particles(trial, episode))
            early = slice(1, max(2, len(episode.times) // 3))
            squares.append(float(((points - points[:1] - episode.points + episode.points[:1])[early] ** 2).mean()))
        errors.append(float(np.median(squares)))
    return errors[0] <= errors[1]


def identify(
    episodes: list[Episode],
    start: EngineBase,
    names: tuple[str, ...],
    *,
    iterations: int,
    jobs: int,
    progress: Callable[[int, int, float], None] | None = None,
) -> tuple[EngineBase, Calibration]:
    """Fit material parameters; intervals contain the engine's own error (`Parameter.model_error`).

    Args:
        episodes: What to follow.
        start: Mean of the prior, and everything that is not fitted.
        names: Fields of Material.
        iterations: Most Gauss-Newton steps.
        jobs: Processes.
        progress: Called with (step, steps, RMS in metres).

    Raises:
        PlopError: No episode, or the engine is unstable.
    """
    if not episodes:
        raise PlopError(
            "There is no episode to fit the engine to.",
            expected="at least one with a track",
            found="none",
            fix="Run `plop filter` on these recordings.",
        )
    cases: list[Any] = [TrackedCase(episode, start) for episode in episodes]
    coarser = replace(start, spacing_m=COARSER * start.spacing_m)
    slopes: list[Any] = [SlopeCase(episode, coarser) for episode in episodes]
    prior = Posterior.around(start.material, names)
    guess, runs = best_start(slopes, start.material, prior, iterations, jobs)
    found = calibrate(
        cases,
        guess,
        names,
        start.config,
        iterations=iterations,
        jobs=jobs,
        progress=progress,
        slopes=slopes,
        prior=prior,
    )
    estimates = {name: each.with_model_error(PARAMETERS[name]) for name, each in found.estimates.items()}
    return replace(start, material=found.material), replace(found, estimates=estimates, rollouts=found.rollouts + runs)
