"""Fit all sensor parameters of one camera to its residuals, with a covariance that does not trust the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from plop.sensors.estimation.camera_frames import CameraScene
from plop.sensors.estimation.parameters import COUNT, LINEAR, PRIOR_WIDTH, SLICES, TOTAL
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


@dataclass(frozen=True)
class Evidence:
    """What residuals say of the parameters: a quadratic misfit, which adds up over episodes.

    Besides the parameters it holds the systematic errors of outline and depth, each constant and growing with time, in
    units of their standard deviation: they are the same in all episodes, and no number of frames averages them away.
    """

    information: np.ndarray
    """[19 + 24, 19 + 24]"""
    pull: np.ndarray
    """Information times the parameters that fit best, shape [19 + 24]."""

    def __add__(self, other: Evidence) -> Evidence:
        return Evidence(self.information + other.information, self.pull + other.pull)

    def given(self, deviation: np.ndarray) -> Evidence:
        """Give what is left to say when parameters deviate by so much [19]: deviations beyond it."""
        return Evidence(self.information, self.pull - self.information[:, :TOTAL] @ deviation)

    def about(self, basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Give the best coordinates [N] in a basis of deviations and their covariance [N, N].

        Args:
            basis: Columns of the parameters, shape [19, N]; what it does not span is absent.
        """
        count = basis.shape[1]
        spanned = block_diag(basis, np.eye(2 * PATTERNS))
        prior = block_diag((basis.T / PRIOR_WIDTH**2) @ basis, np.eye(2 * PATTERNS))
        covariance = np.linalg.inv(spanned.T @ self.information @ spanned + prior)
        return (covariance @ (spanned.T @ self.pull))[:count], covariance[:count, :count]


@dataclass(frozen=True)
class CameraFit:
    """What the residuals of one camera say about all parameters at once."""

    frames: int
    """Frames looked at."""
    evidence: Evidence
    noise_m: float
    """Noise of one depth pixel, robust standard deviation on the table (or the tool) [m]."""
    counts: dict[str, int]
    """Residuals used, by kind."""


def fit_camera(scene: CameraScene) -> CameraFit:
    """Minimise the Huber loss of all residuals (Huber 1964, iteratively reweighted) by damped Gauss-Newton.

    Where the data tell little the point of linearisation stays (Levenberg 1944): far off, pixels show other things.
    """
    basis = np.eye(TOTAL)[:, :COUNT]
    unknown = np.zeros(TOTAL + 2 * PATTERNS, bool)
    for name in CHANGING:
        unknown[SLICES[name]] = len(scene.sightings) < LEAST_FRAMES
    deviation = np.zeros(TOTAL)
    for blur in BLURS_PX:
        some = scene.sightings[:: 3 if blur > BLURS_PX[-1] and len(scene.sightings) > 3 * LEAST_FRAMES else 1]
        frames = [residuals(scene, sighting, deviation, blur) for sighting in some]
        sigmas = {kind: _sigma(frames, kind) for kind in LEAST_SIGMA}
        shares = [sighting.share for sighting in some]
        evidence = _evidence(frames, shares, sigmas, blur, np.r_[deviation, np.zeros(2 * PATTERNS)], unknown)
        values, covariance = evidence.about(basis)
        precision = np.linalg.inv(covariance)
        step = np.linalg.solve(precision + np.diag(LINEAR[:COUNT] ** -2.0), precision @ (values - deviation[:COUNT]))
        if blur == BLURS_PX[-1] and (np.abs(step) < ENOUGH * np.sqrt(np.diag(covariance))).all():
            break
        deviation[:COUNT] += step
    counts = {kind: sum(len(frame[kind].residual) for frame in frames) for kind in LEAST_SIGMA}
    return CameraFit(len(frames), evidence, sigmas["table"] if counts["table"] else sigmas["tool"], counts)


def _sigma(frames: list[dict[str, Rows]], kind: str) -> float:
    values = np.concatenate([frame[kind].residual for frame in frames])
    if not len(values):
        return LEAST_SIGMA[kind]
    return max(LEAST_SIGMA[kind], 1.4826 * float(np.median(np.abs(values - np.median(values)))))


def _evidence(
    frames: list[dict[str, Rows]],
    shares: list[float],
    sigmas: dict[str, float],
    blur_px: float,
    at: np.ndarray,
    unknown: np.ndarray,
) -> Evidence:
    """Sum up the normal equations around some values [43]; of those that are unknown they say nothing.

    Each frame has systematic errors of its own as well, which are integrated out: an outline of a thousand pixels is
    never trusted beyond PIXEL_ERROR.
    """
    # Neighbouring blurred pixels share their errors: 4 pi blur^2 of them count as one (noise equivalent area).
    shared = {"table": 1.0, "tool": 1.0, "outline": max(1.0, 4 * np.pi * blur_px**2)}
    information, pull = np.zeros((len(at), len(at))), np.zeros(len(at))
    for frame, share in zip(frames, shares, strict=True):
        own, mixed, local = np.eye(PATTERNS), np.zeros((PATTERNS, len(at))), np.zeros(PATTERNS)
        for kind, rows in frame.items():
            size = np.abs(rows.residual) / sigmas[kind]
            weight = np.minimum(1.0, HUBER / np.maximum(size, 1e-12)) / (sigmas[kind] ** 2 * shared[kind])
            design = np.hstack([rows.jacobian, rows.patterns, share * rows.patterns])
            design[:, unknown] = 0
            weighted, target = design * weight[:, None], rows.residual + design @ at
            information += weighted.T @ design
            pull += weighted.T @ target
            mixed += rows.patterns.T @ weighted
            local += (rows.patterns * weight[:, None]).T @ target
            own += (rows.patterns * weight[:, None]).T @ rows.patterns
        explained = np.linalg.solve(own, np.c_[mixed, local])
        information -= mixed.T @ explained[:, :-1]
        pull -= mixed.T @ explained[:, -1]
    return Evidence(information, pull)
