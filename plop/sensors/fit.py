"""Fit all sensor parameters of one camera to its residuals, with a covariance that does not trust the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.sensors.parameters import COUNT, PRIOR_WIDTH
from plop.sensors.residuals import Rows, residuals
from plop.sensors.scene import CameraScene

BLURS_PX = (3.0, 2.0, 1.2, 1.2)
"""Blur of the outline in each Gauss-Newton step: wide first, to catch motions of several pixels."""
LEAST_SIGMA = {"table": 1e-4, "tool": 1e-4, "outline": 0.02}
"""Residuals are never trusted more than this [m, m, share of a pixel]."""
HUBER = 1.5
LAGS = 2
"""Frames this far apart may still have errors in common."""


@dataclass(frozen=True)
class CameraFit:
    """What the residuals of one camera say about all parameters at once."""

    deviation: np.ndarray
    """Best parameters as deviations from 'absent', shape [15]."""
    covariance: np.ndarray
    """Shape [15, 15]."""
    noise_m: float
    """Noise of one depth pixel, robust standard deviation on the table (or the tool) [m]."""
    counts: dict[str, int]
    """Residuals used, by kind."""


def fit_camera(scene: CameraScene) -> CameraFit:
    """Minimise the Huber loss of all residuals by Gauss-Newton (Huber 1964, iteratively reweighted)."""
    deviation = np.zeros(COUNT)
    for blur in BLURS_PX:
        frames = [residuals(scene, sighting, deviation, blur) for sighting in scene.sightings]
        sigmas = {kind: _sigma(frames, kind) for kind in LEAST_SIGMA}
        information, scores = _normal(frames, sigmas, blur)
        prior = np.diag(PRIOR_WIDTH**-2.0)
        step = np.linalg.solve(information + prior, scores.sum(0) - prior @ deviation)
        deviation = deviation + np.clip(step, -PRIOR_WIDTH, PRIOR_WIDTH)
    # Scores after the last step, by linearisation: what the sandwich needs are the residuals at the solution.
    last = [{kind: Rows(rows.residual - rows.jacobian @ step, rows.jacobian) for kind, rows in frame.items()}
            for frame in frames]  # fmt: skip
    information, scores = _normal(last, sigmas, BLURS_PX[-1])
    counts = {kind: sum(len(frame[kind].residual) for frame in frames) for kind in LEAST_SIGMA}
    noise = sigmas["table"] if counts["table"] else sigmas["tool"]
    return CameraFit(deviation, _covariance(information + np.diag(PRIOR_WIDTH**-2.0), scores), noise, counts)


def _sigma(frames: list[dict[str, Rows]], kind: str) -> float:
    values = np.concatenate([frame[kind].residual for frame in frames])
    if not len(values):
        return LEAST_SIGMA[kind]
    return max(LEAST_SIGMA[kind], 1.4826 * float(np.median(np.abs(values - np.median(values)))))


def _normal(frames: list[dict[str, Rows]], sigmas: dict[str, float], blur_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Sum up the normal equations: information [15, 15] and the score of every frame [F, 15]."""
    # Neighbouring blurred pixels share their errors: 4 pi blur^2 of them count as one (noise equivalent area).
    shared = {"table": 1.0, "tool": 1.0, "outline": max(1.0, 4 * np.pi * blur_px**2)}
    information, scores = np.zeros((COUNT, COUNT)), np.zeros((len(frames), COUNT))
    for index, frame in enumerate(frames):
        for kind, rows in frame.items():
            size = np.abs(rows.residual) / sigmas[kind]
            weight = np.minimum(1.0, HUBER / np.maximum(size, 1e-12)) / (sigmas[kind] ** 2 * shared[kind])
            weighted = rows.jacobian * weight[:, None]
            information += weighted.T @ rows.jacobian
            scores[index] += weighted.T @ rows.residual
    return information, scores


def _covariance(information: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Widen the model's covariance where the scatter over frames asks for it.

    The sandwich over frames (Newey and West 1987, Bartlett weights) sees errors that the pixels of a frame or
    neighbouring frames have in common, but from a few frames it is poor as a matrix. So the model's correlations
    are kept and each standard error is the larger of the two.
    """
    inverse = np.linalg.inv(information)
    frames = len(scores)
    meat = scores.T @ scores
    for lag in range(1, min(LAGS, frames - 1) + 1):
        cross = scores[lag:].T @ scores[:-lag]
        meat += (1 - lag / (LAGS + 1)) * (cross + cross.T)
    meat *= frames / max(frames - 4, 1)
    robust = np.sqrt(np.maximum(np.diag(inverse @ meat @ inverse), 0))
    factor = np.maximum(1.0, robust / np.sqrt(np.diag(inverse)))
    return inverse * factor[:, None] * factor
