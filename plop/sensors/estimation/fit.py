"""Fit all sensor parameters of one camera to its residuals, with a covariance that does not trust the model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plop.sensors.estimation.camera_frames import CameraScene
from plop.sensors.estimation.parameters import COUNT, PRIOR_WIDTH, SLICES
from plop.sensors.estimation.residuals import PATTERNS, Rows, residuals

BLURS_PX = (3.0, 2.0, *([1.2] * 8))
"""Blur of the outline in each Gauss-Newton step: wide first, to catch motions of several pixels."""
ENOUGH = 0.3
"""The fit ends when no parameter moves by more than this share of its standard error."""
LEAST_SIGMA = {"table": 1e-4, "tool": 1e-4, "outline": 0.02}
"""Residuals are never trusted more than this [m, m, share of a pixel]."""
HUBER = 1.5
CHANGING, LEAST_FRAMES = ("clock", "pose_drift"), 6
"""Faults that show as a change over time are only fitted to at least so many frames; else nothing is known of them."""
LAGS = 2
"""Frames this far apart may still have errors in common."""


@dataclass(frozen=True)
class CameraFit:
    """What the residuals of one camera say about all parameters at once."""

    frames: int
    """Frames looked at."""
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
    deviation, fixed = np.zeros(COUNT), np.zeros(COUNT, bool)
    for name in CHANGING:
        fixed[SLICES[name]] = len(scene.sightings) < LEAST_FRAMES
    width = np.where(fixed, 1e-6, 1.0) * PRIOR_WIDTH
    prior = np.diag(width**-2.0)
    for blur in BLURS_PX:
        some = scene.sightings[:: 3 if blur > BLURS_PX[-1] and len(scene.sightings) > 3 * LEAST_FRAMES else 1]
        frames = [residuals(scene, sighting, deviation, blur) for sighting in some]
        sigmas = {kind: _sigma(frames, kind) for kind in LEAST_SIGMA}
        information, scores, _ = _normal(frames, sigmas, blur)
        inverse = np.linalg.inv(information + prior)
        step = inverse @ (scores.sum(0) - prior @ deviation)
        deviation = deviation + np.clip(step, -width, width)
        if blur == BLURS_PX[-1] and (np.abs(step) < ENOUGH * np.sqrt(np.diag(inverse))).all():
            break
    # Scores after the last step, by linearisation: what the sandwich needs are the residuals at the solution.
    last = [
        {kind: replace(rows, residual=rows.residual - rows.jacobian @ step) for kind, rows in frame.items()}
        for frame in frames
    ]
    information, scores, systematic = _normal(last, sigmas, BLURS_PX[-1])
    counts = {kind: sum(len(frame[kind].residual) for frame in frames) for kind in LEAST_SIGMA}
    noise = sigmas["table"] if counts["table"] else sigmas["tool"]
    covariance = _covariance(information + prior, scores, systematic)
    covariance[fixed, fixed] = PRIOR_WIDTH[fixed] ** 2
    return CameraFit(len(frames), np.where(fixed, 0, deviation), covariance, noise, counts)


def _sigma(frames: list[dict[str, Rows]], kind: str) -> float:
    values = np.concatenate([frame[kind].residual for frame in frames])
    if not len(values):
        return LEAST_SIGMA[kind]
    return max(LEAST_SIGMA[kind], 1.4826 * float(np.median(np.abs(values - np.median(values)))))


def _normal(
    frames: list[dict[str, Rows]], sigmas: dict[str, float], blur_px: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sum up the normal equations.

    Returns:
        Information [15, 15], the score of every frame [F, 15], and the score of each systematic pattern [P, 15].
    """
    # Neighbouring blurred pixels share their errors: 4 pi blur^2 of them count as one (noise equivalent area).
    shared = {"table": 1.0, "tool": 1.0, "outline": max(1.0, 4 * np.pi * blur_px**2)}
    information, scores = np.zeros((COUNT, COUNT)), np.zeros((len(frames), COUNT))
    systematic = np.zeros((PATTERNS, COUNT))
    for index, frame in enumerate(frames):
        for kind, rows in frame.items():
            size = np.abs(rows.residual) / sigmas[kind]
            weight = np.minimum(1.0, HUBER / np.maximum(size, 1e-12)) / (sigmas[kind] ** 2 * shared[kind])
            weighted = rows.jacobian * weight[:, None]
            information += weighted.T @ rows.jacobian
            scores[index] += weighted.T @ rows.residual
            systematic += rows.patterns.T @ weighted
    return information, scores, systematic


def _covariance(information: np.ndarray, scores: np.ndarray, systematic: np.ndarray) -> np.ndarray:
    """Widen the model's covariance where the scatter over frames asks for it.

    The sandwich over frames (Newey and West 1987, Bartlett weights) sees errors that the pixels of a frame or
    neighbouring frames have in common. Seen in coordinates in which the model's covariance is the identity, the
    variance along each of the sandwich's axes is taken as the larger of the two: so what the data hardly tell
    stays hardly told, and few frames cannot make anything surer than the model. What all frames have in common
    does not scatter over them: the systematic patterns come on top.
    """
    frames = len(scores)
    meat = scores.T @ scores
    for lag in range(1, min(LAGS, frames - 1) + 1):
        cross = scores[lag:].T @ scores[:-lag]
        meat += (1 - lag / (LAGS + 1)) * (cross + cross.T)
    root = np.linalg.inv(np.linalg.cholesky(information))
    sizes, axes = np.linalg.eigh(root @ meat @ root.T)
    shared = root @ systematic.T
    wide = (axes * np.maximum(sizes, 1.0)) @ axes.T + shared @ shared.T
    return root.T @ wide @ root
