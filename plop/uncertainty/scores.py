"""Scores of a band on held-out episodes: bands.json of `plop eval`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy.special import ndtr

from plop.artifacts.result_file import ResultFile
from plop.statistics.bootstrap import Interval, bootstrap_interval
from plop.uncertainty.band import NOMINAL, Band
from plop.uncertainty.errors import PointErrors

METHODS = {
    "ensemble": "the ensemble's spread and the noise of the tracks, as they are",
    "widened": "the same times the conformal factor: the band of the rollout",
    "constant": "the same prediction with one conformal radius everywhere",
    "persistence": "nothing moves, with one conformal radius everywhere",
}
CONVENTIONS = {
    "coverage": "share of measured points inside the ball of 90 %",
    "coverage_end": "the same in the last frame",
    "nees": "squared error over variance, mean of three coordinates; 1 is consistent, more is overconfident",
    "crps_mm": "continuous ranked probability score of a normal coordinate [mm]; smaller is better",
    "radius_mm": "mean radius of the ball [mm]; smaller is sharper, at the same coverage",
}


@dataclass(frozen=True, kw_only=True)
class BandScores(ResultFile):
    """Scores of a band and of its rivals: means over test episodes, each of which is a mean over its points."""

    FILE: ClassVar[str] = "bands.json"
    COMMAND: ClassVar[str] = "eval"
    SCHEMA: ClassVar[int] = 1

    band: Band
    methods: Mapping[str, Mapping[str, Interval]]
    """Method -> score -> mean with its interval over episodes."""
    episodes: Mapping[str, Mapping[str, Mapping[str, float]]]
    """Episode -> method -> score."""
    left_out: Mapping[str, str]
    """Episode -> why."""
    meaning: Mapping[str, str] = field(default_factory=lambda: METHODS)
    conventions: Mapping[str, str] = field(default_factory=lambda: CONVENTIONS)


def score_bands(errors: Sequence[PointErrors], band: Band, left_out: Mapping[str, str], *, seed: int = 0) -> BandScores:
    """Score a band on episodes that no model, and no calibration, has seen.

    Args:
        errors: Of at least one episode.
        band: The rollout's.
        left_out: Episodes without a score, and why.
        seed: Of the bootstrap.
    """
    episodes = {each.name: _episode(each, band) for each in errors}
    methods = {
        method: {score: _mean([each[method][score] for each in episodes.values()], seed) for score in CONVENTIONS}
        for method in METHODS
    }
    return BandScores(band=band, methods=methods, episodes=episodes, left_out=left_out)


def _mean(values: Sequence[float], seed: int) -> Interval:
    found = bootstrap_interval(values, seed=seed)
    assert found is not None
    return found


def _episode(errors: PointErrors, band: Band) -> dict[str, dict[str, float]]:
    ones = np.ones_like(errors.spread_m)
    sigmas = {
        "ensemble": band.sigma_m(errors.spread_m, widened=False),
        "widened": band.sigma_m(errors.spread_m),
        "constant": ones * band.constant_m / NOMINAL,
        "persistence": ones * band.persistence_m / NOMINAL,
    }
    last = errors.counts.copy()
    last[:-1] = False
    last = last if last.any() else errors.counts  # every point is hidden at the end
    found = {}
    for method, sigma in sigmas.items():
        error = errors.motion_m if method == "persistence" else errors.error_m
        found[method] = {
            **score(error[errors.counts], sigma[errors.counts]),
            "coverage_end": score(error[last], sigma[last])["coverage"],
        }
    return found


def score(error_m: np.ndarray, sigma_m: np.ndarray) -> dict[str, float]:
    """Score normal predictions of points.

    Args:
        error_m: Measured minus predicted position, [P, 3] [m].
        sigma_m: Predicted standard deviation of one coordinate, [P] [m]; above 0.

    Returns:
        coverage, nees (normalised estimation error squared: Bar-Shalom, Li and Kirubarajan 2001, Sec. 5.4, over the
        dimension), crps_mm (closed form: Gneiting and Raftery 2007, Sec. 4.2) and radius_mm, each a mean over points.
    """
    z = error_m / sigma_m[:, None]
    density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    crps_m = sigma_m[:, None] * (z * (2 * ndtr(z) - 1) + 2 * density - 1 / np.sqrt(np.pi))
    return {
        "coverage": float((np.linalg.norm(z, axis=1) <= NOMINAL).mean()),
        "nees": float((z**2).mean()),
        "crps_mm": 1000 * float(crps_m.mean()),
        "radius_mm": 1000 * NOMINAL * float(sigma_m.mean()),
    }
