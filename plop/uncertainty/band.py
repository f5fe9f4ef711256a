"""The 90 % band of a rollout: band.json of `plop rollout --members`.

A measured coordinate is taken as normal around the prediction, with the variance spread^2 + noise^2. The nominal
radius of the ball that holds 90 % of such points is 2.5003 standard deviations; the band's radius is `factor` times
that, so that it holds 90 % of the measured points of episodes like those of validation (`plop.uncertainty.conformal`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy.stats import chi2

from plop.artifacts.result_file import ResultFile
from plop.uncertainty.conformal import group_quantile
from plop.uncertainty.errors import PointErrors

LEVEL = 0.9
"""Share of measured points inside the band."""
NOMINAL = float(np.sqrt(chi2.ppf(LEVEL, 3)))
"""Radius of that share in three dimensions, in standard deviations of one coordinate."""
CONVENTIONS = {
    "truth": "positions of up to 400 surface points tracked by `plop filter`; frame 0 and hidden points do not count",
    "spread": "RMS over the other models and coordinates of their distance from the prediction, per coordinate",
    "noise": "standard deviation of one coordinate of a track, median over the validation episodes",
    "radius": "factor * 2.5003 * sqrt(spread^2 + noise^2)",
    "factor": "hierarchical conformal quantile of distance over nominal radius; an episode is one unit",
}


@dataclass(frozen=True, kw_only=True)
class Band(ResultFile):
    """How wide the band around a prediction is."""

    FILE: ClassVar[str] = "band.json"
    COMMAND: ClassVar[str] = "rollout"
    SCHEMA: ClassVar[int] = 1

    level: float = LEVEL
    conventions: Mapping[str, str] = field(default_factory=lambda: CONVENTIONS)
    models: int
    """Models of the ensemble, that of the rollout included."""
    noise_m: float
    factor: float
    """By which the nominal radius is multiplied."""
    guaranteed: bool
    """Whether there are enough validation episodes for the finite-sample guarantee."""
    constant_m: float
    """Radius that does the same everywhere, without the spread [m]."""
    persistence_m: float
    """Radius that does the same around points that do not move [m]."""
    validation: tuple[str, ...]
    """Episodes that the factor is from."""

    def sigma_m(self, spread_m: np.ndarray, *, widened: bool = True) -> np.ndarray:
        """Return the standard deviation of a measured coordinate [m]."""
        return np.asarray((self.factor if widened else 1.0) * np.sqrt(np.square(spread_m) + self.noise_m**2))

    def radius_m(self, spread_m: np.ndarray) -> np.ndarray:
        """Return the band's radius for a spread (`ensemble_spread`), of any shape [m]."""
        return NOMINAL * self.sigma_m(spread_m)


def calibrated(errors: Sequence[PointErrors], models: int) -> Band:
    """Choose the width of a band from validation episodes.

    Args:
        errors: Of at least one episode that no model was trained on.
        models: Models of the ensemble.
    """
    noise_m = float(np.median([each.noise_m for each in errors]))
    unit = [NOMINAL * np.sqrt(np.square(each.spread_m) + noise_m**2) for each in errors]
    far = [np.linalg.norm(each.error_m, axis=-1) for each in errors]
    moved = [np.linalg.norm(each.motion_m, axis=-1) for each in errors]

    def quantile(values: Sequence[np.ndarray]) -> tuple[float, bool]:
        return group_quantile([v[each.counts] for v, each in zip(values, errors, strict=True)], LEVEL)

    factor, guaranteed = quantile([f / u for f, u in zip(far, unit, strict=True)])
    return Band(
        models=models,
        noise_m=noise_m,
        factor=factor,
        guaranteed=guaranteed,
        constant_m=quantile(far)[0],
        persistence_m=quantile(moved)[0],
        validation=tuple(each.name for each in errors),
    )
