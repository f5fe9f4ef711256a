"""Fit material parameters to recorded motions: Gauss-Newton over whole rollouts, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from scipy.stats import t as student

from plop.compute.workers import workers
from plop.errors import PlopError
from plop.parameters import Estimate, Parameter
from plop.physics.calibration.recorded_motion import Case
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.statistics.cluster_robust import clusters

_LEVELS = 6
"""Largest number of halvings in the line search before the fit counts as converged."""
_REACH = 20
"""Longest step along one parameter, in its finite differences: one to which the data hardly respond stays near."""


def _of_material(
    name: str, unit: str, low: float, high: float, step: float, source: str, *, logarithmic: bool = False
) -> Parameter:
    given = getattr(Material(), name)
    return Parameter(name, unit, low, high, step, default=given, logarithmic=logarithmic, source=source)


_COULOMB = "Coulomb 1785; Johnson, Contact Mechanics, 1985, ch. 7"
PARAMETERS = {
    p.name: p
    for p in (
        _of_material("youngs_modulus_pa", "Pa", 1e2, 1e8, 0.05, "Hooke's law", logarithmic=True),
        _of_material("poisson", "-", 0.0, 0.49, -0.01, "Hooke's law"),
        _of_material("density_kg_m3", "kg/m^3", 20.0, 2e4, 0.05, "Newton's second law", logarithmic=True),
        _of_material("damping_per_s", "1/s", 0.0, 200.0, 1.0, "mass-proportional Rayleigh damping; Bathe 1996, ch. 9"),
        _of_material("viscosity_pa_s", "Pa s", 0.0, 1e3, 2.0, "Kelvin-Voigt solid; Larson 1999"),
        _of_material("table_friction", "-", 0.0, 2.0, 0.03, _COULOMB),
        _of_material("tool_friction", "-", 0.0, 2.0, 0.03, _COULOMB),
        _of_material("toughness_j_m2", "J/m^2", 0.0, 1e3, 2.0, "Griffith 1921; Atkins 2009, ch. 2"),
        _of_material("table_slip_m_s", "m/s", 1e-5, 1.0, 0.1, "regularised Coulomb friction", logarithmic=True),
    )
}
"""Parameters of a `Material` that can be fitted, by name."""


@dataclass(frozen=True)
class Calibration:
    """Result of a fit."""

    material: Material
    estimates: dict[str, Estimate]
    rms_before_m: float
    """RMS distance of all compared points at all frames, initial parameters [m]."""
    rms_after_m: float
    """The same with the fitted parameters [m]."""
    iterations: int
    rollouts: int
    """Episodes simulated."""


def calibrate(
    cases: Sequence[Case],
    start: Material,
    names: Sequence[str],
    config: EngineConfig,
    *,
    iterations: int = 6,
    jobs: int = 1,
    progress: Callable[[int, int, float], None] | None = None,
    slopes: Sequence[Case] | None = None,
) -> Calibration:
    """Minimise the squared distance between engine and measured points.

    Derivatives are differences at the start and at the end, of which the last give the intervals; between them every
    step corrects them by what it found (Broyden 1965), and they are differenced anew only where a step fails.

    Intervals come from the scatter between independent blocks (episodes; with fewer than four, fifths of an episode),
    because errors of neighbouring points and frames are correlated; blocks are weighted by leverage (`clusters`).

    Args:
        cases: Episodes.
        start: Initial values; parameters that are not named are fixed.
        names: Parameters to fit, keys of PARAMETERS.
        config: Grid and table; `table_z_m` is taken from each case.
        iterations: Largest number of Gauss-Newton steps.
        jobs: Processes that share the rollouts.
        progress: Called after each step with (step, iterations, RMS in metres).
        slopes: The same episodes on a coarser grid, which is enough for derivatives; `cases` when absent.

    Raises:
        PlopError: An unknown parameter, no episode, or the engine is unstable at the start.
    """
    unknown = [name for name in names if name not in PARAMETERS]
    if unknown or not names or not cases:
        raise PlopError(
            "There is nothing to calibrate.",
            where=", ".join(unknown) or "cases and names",
            expected=f"episodes, and some of {', '.join(PARAMETERS)}",
            found=f"{len(cases)} episodes, {', '.join(names) or 'no name'}",
            fix="Give at least one episode and one of these parameters.",
        )
    fit = _Fit(cases, slopes or cases, start, [PARAMETERS[name] for name in names], config, jobs)
    return fit.run(iterations, progress)


class _Fit:
    """The running fit; coordinates are `Parameter.encode` of the values."""

    def __init__(
        self,
        cases: Sequence[Case],
        slopes: Sequence[Case],
        start: Material,
        parameters: list[Parameter],
        config: EngineConfig,
        jobs: int,
    ) -> None:
        self.cases, self.slopes, self.start, self.parameters = cases, slopes, start, parameters
        self.config, self.jobs = config, jobs
        self.rollouts = 0

    def material(self, coordinates: np.ndarray) -> Material:
        values: dict[str, Any] = {p.name: p.decode(c) for p, c in zip(self.parameters, coordinates, strict=True)}
        return replace(self.start, **values)

    def residuals(self, points: list[np.ndarray], cases: Sequence[Case] | None = None) -> list[list[np.ndarray]]:
        """Simulate all episodes at all points; residuals [T, M, 3] in metres, unmeasured points 0."""
        tasks = [(case, self.material(point)) for point in points for case in cases or self.cases]
        self.rollouts += len(tasks)
        calls = (delayed(_residual)(case, material, self.config) for case, material in tasks)
        with workers():
            flat = Parallel(n_jobs=self.jobs)(calls)
        count = len(self.cases)
        return [flat[k * count : (k + 1) * count] for k in range(len(points))]

    def run(self, iterations: int, progress: Callable[[int, int, float], None] | None) -> Calibration:
        here = np.array([p.encode(max(getattr(self.start, p.name), p.low)) for p in self.parameters])
        residual = self.residuals([here])[0]
        jacobian, fresh = self.jacobian(here, residual), True
        before = _rms(residual)
        damping, done = 1e-3, 0
        for done in range(1, iterations + 1):
            better = self.step(here, residual, jacobian, damping)
            if better is None:
                if fresh and self.slopes is self.cases:
                    break
                # where derivatives of the coarser grid lead nowhere, those of the engine's own are taken
                self.slopes = self.cases if fresh else self.slopes
                jacobian, fresh = self.jacobian(here, residual), True
                continue
            jacobian, fresh = _corrected(jacobian, better[0] - here, residual, better[1]), False
            gain = _cost(residual) - _cost(better[1])
            here, residual, damping = better
            if progress is not None:
                progress(done, iterations, _rms(residual))
            if gain < 1e-3 * _cost(residual):
                break
        estimates = self.intervals(here, residual, jacobian if fresh else self.jacobian(here, residual))
        return Calibration(self.material(here), estimates, before, _rms(residual), done, self.rollouts)

    def jacobian(self, here: np.ndarray, residual: list[np.ndarray]) -> list[list[np.ndarray]]:
        """Derivatives by forward differences (backward at an upper bound), [parameter][episode]."""
        points, steps = [], []
        for k, parameter in enumerate(self.parameters):
            point = here.copy()
            point[k] += parameter.step
            if parameter.decode(point[k]) in (parameter.low, parameter.high):
                point[k] = here[k] - parameter.step
            points.append(point)
            steps.append(point[k] - here[k])
        if self.slopes is self.cases:
            moved = self.residuals(points)
        else:
            residual, *moved = self.residuals([here, *points], self.slopes)
        return [[(m - r) / s for m, r in zip(row, residual, strict=True)] for row, s in zip(moved, steps, strict=True)]

    def step(
        self, here: np.ndarray, residual: list[np.ndarray], jacobian: list[list[np.ndarray]], damping: float
    ) -> tuple[np.ndarray, list[np.ndarray], float] | None:
        """Take one damped step that lowers the cost; None when there is none."""
        hessian, gradient = _normal_equations(jacobian, residual)
        low = np.array([p.encode(p.low) if p.low > 0 or not p.logarithmic else -np.inf for p in self.parameters])
        high = np.array([p.encode(p.high) for p in self.parameters])
        reach = _REACH * np.array([abs(p.step) for p in self.parameters])
        free = ~((here <= low) & (gradient > 0)) & ~((here >= high) & (gradient < 0))
        for _ in range(_LEVELS):
            scaled = hessian + np.diag(damping * np.diag(hessian) + 1e-30)
            move = np.zeros(len(here))
            move[free] = -np.linalg.solve(scaled[np.ix_(free, free)], gradient[free])
            there = np.clip(here + np.clip(move, -reach, reach), low, high)
            trial = self.residuals([there])[0]
            if _cost(trial) < _cost(residual):
                return there, trial, damping / 10
            damping = max(10 * damping, 0.1)
        return None

    def intervals(
        self, here: np.ndarray, residual: list[np.ndarray], jacobian: list[list[np.ndarray]]
    ) -> dict[str, Estimate]:
        """Return 95 % intervals; infinite for a parameter at its bound, or one without influence on the data."""
        values = [p.decode(c) for p, c in zip(self.parameters, here, strict=True)]
        bound = np.array([v <= p.low or v >= p.high for v, p in zip(values, self.parameters, strict=True)])
        width = np.full(len(here), np.inf)
        hessian, _ = _normal_equations(jacobian, residual)
        free = np.nonzero(~bound)[0]
        scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
        normal = hessian / np.outer(scale, scale)
        if len(free) and np.linalg.eigvalsh(normal[np.ix_(free, free)])[0] > 1e-6:
            found = clusters(*_blocks([jacobian[k] for k in free], residual))
            width[free] = student.ppf(0.975, found.freedom) * np.sqrt(np.diag(found.spread))
        ends = [
            (-np.inf, np.inf) if np.isinf(w) else (p.decode(c - w), p.decode(c + w))
            for p, c, w in zip(self.parameters, here, width, strict=True)
        ]
        return {
            p.name: Estimate(v, low, high, p.unit, bool(b)).within(p)
            for p, v, (low, high), b in zip(self.parameters, values, ends, bound, strict=True)
        }


def _corrected(
    jacobian: list[list[np.ndarray]], move: np.ndarray, before: list[np.ndarray], after: list[np.ndarray]
) -> list[list[np.ndarray]]:
    """Correct derivatives by what a step found, in proportion to its share of each parameter (Broyden 1965, Eq. 4.5).

    The parameters are compared in units of what they do to the residual.
    """
    size = np.array([_cost(row) for row in jacobian])
    shares = size * move / max(float(size @ move**2), 1e-300)
    missed = [
        b - a - sum(m * row[e] for m, row in zip(move, jacobian, strict=True))
        for e, (a, b) in enumerate(zip(before, after, strict=True))
    ]
    return [
        [j + share * m for j, m in zip(row, missed, strict=True)] for row, share in zip(jacobian, shares, strict=True)
    ]


def _residual(case: Case, material: Material, config: EngineConfig) -> np.ndarray:
    difference = case.predict(material, replace(config, table_z_m=case.table_z_m)) - case.observed
    return np.asarray(np.nan_to_num(difference, nan=0.0))


def _cost(residual: list[np.ndarray]) -> float:
    return float(sum(np.sum(r * r) for r in residual))


def _rms(residual: list[np.ndarray]) -> float:
    return float(np.sqrt(_cost(residual) / sum(r.size // 3 for r in residual)))


def _normal_equations(jacobian: list[list[np.ndarray]], residual: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    flat = np.stack([np.concatenate([j.ravel() for j in row]) for row in jacobian])
    return flat @ flat.T, flat @ np.concatenate([r.ravel() for r in residual])


def _blocks(jacobian: list[list[np.ndarray]], residual: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Hessian [blocks, P, P] and negative gradient [blocks, P] of half the cost in each independent block."""
    found = []
    for episode, r in enumerate(residual):
        pieces = np.array_split(np.arange(len(r)), 1 if len(residual) >= 4 else min(5, len(r)))
        found += [_normal_equations([[row[episode][piece]] for row in jacobian], [r[piece]]) for piece in pieces]
    return np.stack([hessian for hessian, _ in found]), -np.stack([gradient for _, gradient in found])
