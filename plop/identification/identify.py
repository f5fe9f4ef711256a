"""Fit the engine's material to tracked episodes, so that it can stand in for the real object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from trimesh.triangles import area, mass_properties

from plop.comparison.engine_run import predict_points, start_particles
from plop.compute.workers import workers
from plop.errors import PlopError
from plop.identification.first_guess import stiffness_first
from plop.identification.tracked_case import SlopeCase, TrackedCase, mean_square
from plop.physics.adapters.filled import EngineBase
from plop.physics.calibration.gauss_newton import Calibration, calibrate
from plop.tracking.episode import Episode

PARTICLES = 1300
"""Particles that fill the object unless a spacing is given: with half as many, laws that act where the object bends
or is cut respond with a cosine of 0.7 to the true response instead of 0.85 (docs/results/parts.md)."""
COARSER = 1.4
"""Distance of the particles with which derivatives are taken, in units of the engine's own: a quarter of the time."""
NAMES = ("youngs_modulus_pa", "damping_per_s", "table_friction", "tool_friction", "table_slip_m_s")
"""Parameters that are fitted unless others are named."""


def spacing_for(episodes: list[Episode], particles: int = PARTICLES) -> float:
    """Choose a distance of particles so that about so many fill the object [m].

    There is one for each cell and, since the outer ones lie on the surface, half a one more for each cell face there.
    """
    found = []
    for episode in episodes:
        triangles = episode.vertices[episode.faces]
        volume, surface = abs(mass_properties(triangles).volume), float(area(triangles).sum())
        found.append(max(np.roots([particles, 0, -surface / 2, -volume]).real.tolist()))
    return round(float(np.median(found)), 5)


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


OUTLIER = 2.0
"""An episode whose error is so many times the median's is left out of the fit: something else happened in it."""


def outliers(episodes: list[Episode], base: EngineBase, jobs: int = 1) -> dict[str, str]:
    """Find episodes that the engine follows far worse than the others; name -> why."""
    with workers():
        squares = Parallel(n_jobs=jobs)(delayed(mean_square)(TrackedCase(episode, base)) for episode in episodes)
    rms = 1000 * np.sqrt(np.array(squares))
    middle = float(np.median(rms))
    if len(episodes) < 4:
        return {}
    return {
        e.name: f"the engine misses it by {r:.2f} mm RMS, the others by {middle:.2f} mm"
        for e, r in zip(episodes, rms, strict=True)
        if r > OUTLIER * middle
    }


def identify(
    episodes: list[Episode],
    start: EngineBase,
    names: tuple[str, ...],
    *,
    iterations: int,
    jobs: int,
    progress: Callable[[int, int, float], None] | None = None,
) -> tuple[EngineBase, Calibration]:
    """Fit material parameters.

    Args:
        episodes: What to follow.
        start: First guess, and everything that is not fitted.
        names: Fields of Material.
        iterations: Most Gauss-Newton steps.
        jobs: Processes.
        progress: Called with (step, steps, RMS in metres).

    Raises:
        PlopError: No episode, or the engine is unstable with the first guess.
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
    guess, runs = stiffness_first(slopes, start.material, jobs) if "youngs_modulus_pa" in names else (start.material, 0)
    found = calibrate(
        cases, guess, names, start.config, iterations=iterations, jobs=jobs, progress=progress, slopes=slopes
    )
    return replace(start, material=found.material), replace(found, rollouts=found.rollouts + runs)
