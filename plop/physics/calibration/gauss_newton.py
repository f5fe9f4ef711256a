"""Fit material parameters to recorded motions: Gauss-Newton over whole rollouts, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from plop.compute.workers import workers
from plop.errors import PlopError
from plop.parameters import Estimate, Parameter
from plop.physics.calibration.least_squares import intervals, normal_equations, weighed
from plop.physics.calibration.material_parameters import PARAMETERS
from plop.physics.calibration.posterior import Posterior, mean_squares
from plop.physics.calibration.recorded_motion import Case
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material

_REACH = 20
"""Longest step along one parameter, in its finite differences: derivatives hold nearby only."""
_GAIN = 0.01
"""Gain that is expected of a step, in units of the log density, below which the fit has converged: far less than a
likelihood tells."""


@dataclass(frozen=True)
class Calibration:
    """Result of a fit."""

    material: Material
    estimates: dict[str, Estimate]
    rms_before_m: float
    """RMS distance of all compared points at all frames, initial parameters [m]."""
    rms_after_m: float
    """The same with the fitted parameters [m]."""
    episodes_rms_m: list[float]
    """The same of every episode [m]."""
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
    prior: Posterior | None = None,
) -> Calibration:
    """Find the likeliest parameters (`Posterior`).

    Derivatives are differences at the start and at the end, of which the last give the intervals; between them every
    step corrects them by what it found (Broyden 1965), and they are differenced anew where no step is left to take.

    Args:
        cases: Episodes.
        start: Initial values; parameters that are not named are fixed.
        names: Parameters to fit, keys of PARAMETERS.
        config: Grid and table; `table_z_m` is taken from each case.
        iterations: Largest number of Gauss-Newton steps.
        jobs: Processes that share the rollouts.
        progress: Called after each step with (step, iterations, RMS in metres).
        slopes: The same episodes on a coarser grid, which is enough for derivatives; `cases` when absent.
        prior: What is known beforehand; around `start` when absent.

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
    prior = prior or Posterior.around(start, names)
    fit = _Fit(cases, slopes or cases, start, prior, config, _GAIN, jobs)
    return fit.run(iterations, progress)


def minimum_near(
    cases: Sequence[Case], start: Material, posterior: Posterior, config: EngineConfig, iterations: int, gain: float
) -> tuple[float, Material, int]:
    """Go downhill from a start, without intervals; its cost where the engine is unstable is infinite.

    Args:
        cases: Episodes.
        start: Where to begin, and what is not fitted.
        posterior: What is minimised.
        config: As for `calibrate`.
        iterations: Largest number of Gauss-Newton steps.
        gain: What a step has to promise [nats].

    Returns:
        Cost, parameters, and the number of episodes simulated.
    """
    fit = _Fit(cases, cases, start, posterior, config, gain)
    try:
        end = fit.descend(iterations, None)
    except PlopError:  # unstable: the fit says so if all starts are
        return np.inf, start, fit.rollouts
    return fit.cost(end.point, end.residual), posterior.material(start, end.point), fit.rollouts


@dataclass(frozen=True)
class _End:
    """Where a descent ended."""

    point: np.ndarray
    residual: list[np.ndarray]
    jacobian: list[list[np.ndarray]] | None
    """Derivatives by differences at this very point; None where they were corrected since."""
    first_rms_m: float
    steps: int


class _Fit:
    """The running fit; coordinates are `Parameter.encode` of the values."""

    def __init__(
        self,
        cases: Sequence[Case],
        slopes: Sequence[Case],
        start: Material,
        posterior: Posterior,
        config: EngineConfig,
        gain: float,
        jobs: int = 1,
    ) -> None:
        self.cases, self.slopes, self.start, self.posterior = cases, slopes, start, posterior
        self.parameters: list[Parameter] = posterior.parameters
        self.config, self.gain, self.jobs = config, gain, jobs
        self.rollouts = 0

    def residuals(self, points: list[np.ndarray], cases: Sequence[Case] | None = None) -> list[list[np.ndarray]]:
        """Simulate all episodes at all points; residuals [T, M, 3] in metres, unmeasured points 0."""
        tasks = [(case, self.posterior.material(self.start, point)) for point in points for case in cases or self.cases]
        self.rollouts += len(tasks)
        calls = (delayed(_residual)(case, material, self.config) for case, material in tasks)
        with workers():
            flat = Parallel(n_jobs=self.jobs)(calls)
        count = len(self.cases)
        return [flat[k * count : (k + 1) * count] for k in range(len(points))]

    def run(self, iterations: int, progress: Callable[[int, int, float], None] | None) -> Calibration:
        end = self.descend(iterations, progress)
        jacobian = end.jacobian or self.jacobian(end.point, end.residual)
        return Calibration(
            self.posterior.material(self.start, end.point),
            intervals(self.parameters, end.point, *weighed(jacobian, end.residual)),
            end.first_rms_m,
            _rms(end.residual),
            np.sqrt(mean_squares(end.residual)).tolist(),
            end.steps,
            self.rollouts,
        )

    def descend(self, iterations: int, progress: Callable[[int, int, float], None] | None) -> _End:
        here = self.posterior.coordinates(self.start)
        residual = self.residuals([here])[0]
        jacobian, fresh = self.jacobian(here, residual), True
        before = _rms(residual)
        damping, done = 1e-3, 0
        for done in range(1, iterations + 1):
            better = self.step(here, residual, jacobian, damping)
            if better is not None:
                jacobian, fresh = _corrected(jacobian, better[0] - here, residual, better[1]), False
                here, residual, damping = better
                if progress is not None:
                    progress(done, iterations, _rms(residual))
            elif fresh:
                break
            else:
                jacobian, fresh = self.jacobian(here, residual), True
        return _End(here, residual, jacobian if fresh else None, before, done)

    def cost(self, here: np.ndarray, residual: list[np.ndarray]) -> float:
        return self.posterior.cost(here, mean_squares(residual))

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
        """Take one damped step that lowers the cost; None where none does, or none promises much."""
        hessian, gradient = normal_equations(*weighed(jacobian, residual))
        hessian += np.diag(self.posterior.precision)
        gradient += self.posterior.precision * (here - self.posterior.center)
        low = np.array([p.encode(p.low) if p.low > 0 or not p.logarithmic else -np.inf for p in self.parameters])
        high = np.array([p.encode(p.high) for p in self.parameters])
        reach = _REACH * np.array([abs(p.step) for p in self.parameters])
        free = ~((here <= low) & (gradient > 0)) & ~((here >= high) & (gradient < 0))
        while True:
            scaled = hessian + np.diag(damping * np.diag(hessian) + 1e-30)
            move = np.zeros(len(here))
            move[free] = -np.linalg.solve(scaled[np.ix_(free, free)], gradient[free])
            there = np.clip(here + np.clip(move, -reach, reach), low, high)
            move = there - here
            promised = -gradient @ move - move @ hessian @ move / 2
            if promised >= self.gain:
                trial = self.residuals([there])[0]
                if self.cost(there, trial) < self.cost(here, residual):
                    return there, trial, damping / 10
            elif not promised < 0:  # where the step was clipped, a smaller one may promise more
                return None
            damping = max(10 * damping, 0.1)


def _corrected(
    jacobian: list[list[np.ndarray]], move: np.ndarray, before: list[np.ndarray], after: list[np.ndarray]
) -> list[list[np.ndarray]]:
    """Correct derivatives by what a step found, in proportion to its share of each parameter (Broyden 1965, Eq. 4.5).

    The parameters are compared in units of what they do to the residual.
    """
    size = np.array([_squares(row) for row in jacobian])
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


def _squares(residual: list[np.ndarray]) -> float:
    return float(sum(np.sum(r * r) for r in residual))


def _rms(residual: list[np.ndarray]) -> float:
    return float(np.sqrt(_squares(residual) / sum(r.size // 3 for r in residual)))
