"""Fit the engine's material to tracked episodes, so that it can stand in for the real object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from trimesh.triangles import area, mass_properties

from plop.comparison.discretisations import predicted_by_each
from plop.comparison.engine_run import predict_points, start_particles
from plop.compute.workers import workers
from plop.diagnosis.evidence import compared_frames
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.calibration.gauss_newton import Calibration, calibrate
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.tracking.episode import Episode

PARTICLES = 1300
"""Particles that fill the object unless a spacing is given: with half as many, laws that act where the object bends
or is cut respond with a cosine of 0.7 to the true response instead of 0.85 (docs/results/parts.md)."""
COARSER = 1.4
"""Distance of the particles with which derivatives are taken, in units of the engine's own: a quarter of the time."""
NAMES = ("youngs_modulus_pa", "damping_per_s", "table_friction", "tool_friction", "table_slip_m_s")
"""Parameters that are fitted unless others are named."""


@dataclass(frozen=True)
class TrackedCase:
    """An episode as `calibrate` wants it: patches at the compared frames.

    The prediction is the mean over discretisations, as `diagnose` takes it. A fit to one of them takes what its
    particles happen to do, whether a block slips on the table or under the tool, for the object's friction.
    """

    episode: Episode
    base: EngineBase

    @property
    def name(self) -> str:
        """Name of the episode."""
        return self.episode.name

    @property
    def table_z_m(self) -> float | None:
        """Height of the table [m]."""
        return self.episode.table_z_m

    @property
    def observed(self) -> np.ndarray:
        """Measured displacements of the patches, [F, K, 3] [m]; NaN where they could not be seen."""
        frames = compared_frames(len(self.episode.times))
        return np.where(self.episode.seen_patches[frames][..., None], self.episode.motion[frames], np.nan)

    def predict(self, material: Material, config: EngineConfig) -> np.ndarray:
        """Run the engine and give the same, [F, K, 3] [m]; the grid is the base's own, not `config`'s."""
        base = replace(self.base, material=material)
        return self.pooled(np.mean(predicted_by_each(base, self.episode), 0))

    def pooled(self, points: np.ndarray) -> np.ndarray:
        """Average displacements of the followed points [T, M, 3] over patches, [F, K, 3] [m]."""
        return self.episode.pooled((points - points[:1])[compared_frames(len(self.episode.times))])


class SlopeCase(TrackedCase):
    """The same in the one discretisation of its engine, which is enough for derivatives."""

    def predict(self, material: Material, config: EngineConfig) -> np.ndarray:
        """Run the engine and give displacements of the patches, [F, K, 3] [m]."""
        base = replace(self.base, material=material)
        return self.pooled(predict_points(base, self.episode, start_particles(base, self.episode)))


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
        squares = Parallel(n_jobs=jobs)(delayed(_mean_square)(TrackedCase(episode, base)) for episode in episodes)
    rms = 1000 * np.sqrt(np.array(squares))
    middle = float(np.median(rms))
    if len(episodes) < 4:
        return {}
    return {
        e.name: f"the engine misses it by {r:.2f} mm RMS, the others by {middle:.2f} mm"
        for e, r in zip(episodes, rms, strict=True)
        if r > OUTLIER * middle
    }


def _mean_square(case: TrackedCase) -> float:
    error = case.predict(case.base.material, case.base.config) - case.observed
    return float(np.nanmean((error**2).sum(-1)))


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
    found = calibrate(
        cases, start.material, names, start.config, iterations=iterations, jobs=jobs, progress=progress, slopes=slopes
    )
    return replace(start, material=found.material), found
