"""How likely parameters are: episodes of unknown errors, and a weak prior around the initial values.

What an engine misses differs from episode to episode: a drag in which the object sticks or slips by a hair may be off
by more than a press is. With Student's t for the error of an episode (n values, nu degrees of freedom) and a scale s
that is common to all, and the likeliest, the log likelihood is, but for its sign,

    sum over episodes of (nu + n)/2 log(1 + n m / (nu s^2)) + n/2 log(s^2),    m = mean squared distance + floor

(Lange, Little and Taylor, JASA 84, 1989). n is the number of independent values of an episode. Errors of its patches
and frames rise and fall together, so it counts as one displacement: n = 3. A parameter that the recordings do not
determine stays near its initial value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from plop.parameters import Parameter
from plop.physics.calibration.material_parameters import PARAMETERS
from plop.physics.engine.material import Material
from plop.statistics.heavy_tails import FREEDOM

_VALUES = 3
"""Independent values in an episode."""
_FLOOR_M = 1e-5
"""Distance below which no error is known [m]: a camera does not see it."""


@dataclass(frozen=True)
class Posterior:
    """The negative log density of parameters, in the coordinates of the fit (`Parameter.encode`)."""

    parameters: list[Parameter]
    center: np.ndarray
    """Mean of the prior, [P]."""

    @classmethod
    def around(cls, material: Material, names: Sequence[str]) -> Posterior:
        """Take the initial values of a fit for the mean of the prior.

        Args:
            material: They.
            names: Parameters to fit, keys of PARAMETERS.
        """
        parameters = [PARAMETERS[name] for name in names]
        return cls(parameters, _coordinates(parameters, material))

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviations of the prior, [P]."""
        return np.array([p.prior for p in self.parameters])

    @property
    def precision(self) -> np.ndarray:
        """Inverse variances of the prior, [P]."""
        return np.asarray(self.deviations**-2.0)

    def coordinates(self, material: Material) -> np.ndarray:
        """Values of a material, [P]."""
        return _coordinates(self.parameters, material)

    def material(self, start: Material, coordinates: np.ndarray) -> Material:
        """Give a material the values at coordinates [P]."""
        values: dict[str, Any] = {p.name: p.decode(c) for p, c in zip(self.parameters, coordinates, strict=True)}
        return replace(start, **values)

    def cost(self, coordinates: np.ndarray, squares: np.ndarray) -> float:
        """Give the negative log density, up to a constant.

        Args:
            coordinates: [P].
            squares: Mean squared distance in every episode, [E] [m^2]; infinite where the engine is unstable.
        """
        if np.isinf(squares).any():
            return float("inf")
        off = (coordinates - self.center) / self.deviations
        own = squares + _FLOOR_M**2
        common = _common(own)
        unlikely = (FREEDOM + _VALUES) / 2 * np.log1p(_VALUES * own / (FREEDOM * common))
        return float(unlikely.sum() + _VALUES / 2 * len(own) * np.log(common) + off @ off / 2)


def _coordinates(parameters: list[Parameter], material: Material) -> np.ndarray:
    return np.array([p.encode(max(getattr(material, p.name), p.low)) for p in parameters])


def mean_squares(residual: Sequence[np.ndarray]) -> np.ndarray:
    """Mean squared distance of the measured points of each episode, [E] [m^2]; those not measured are 0."""
    return np.array([float((r**2).sum()) / _measured(r) for r in residual])


def roots_of_weights(residual: Sequence[np.ndarray]) -> np.ndarray:
    """Root of the weight of each episode in a least-squares step, [E] [1/m].

    With it half the weighted squares have the gradient of the log likelihood.
    """
    counts = np.array([_measured(r) for r in residual])
    own = mean_squares(residual) + _FLOOR_M**2
    return np.asarray(np.sqrt(_VALUES * _precisions(own, _common(own)) / counts))


def _common(squares: np.ndarray) -> float:
    """Find the likeliest scale of all episodes, squared: with it their mean weighted square is 1."""
    low, high = np.log(squares.min()), np.log(squares.max())
    if high - low < 1e-9:
        return float(squares.mean())

    def excess(log_scale: float) -> float:
        return float((_precisions(squares, np.exp(log_scale)) * squares).mean() - 1)

    return float(np.exp(brentq(excess, low, high)))


def _precisions(squares: np.ndarray, common: float) -> np.ndarray:
    """Weights of iteratively reweighted least squares, [E] [1/m^2]."""
    return np.asarray((FREEDOM + _VALUES) / (FREEDOM * common + _VALUES * squares))


def _measured(residual: np.ndarray) -> int:
    return max(int((residual != 0).any(-1).sum()), 1)
