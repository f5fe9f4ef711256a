"""Residuals and responses of all episodes, in units of what the base is expected to miss.

    residual = measured - prediction of the base            response = engine with an effect - engine without

Both are displacements of patches of the surface. For the engine as base this is the model's own derivative;
for a learned base the engine supplies only the difference that an effect makes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plop.tracking.episode import Episode

FRAMES = 12
"""Frames of an episode that are compared, evenly spaced to its end."""
BLOCKS = 8
"""Parts of an object whose errors count as independent of each other."""
_BINS = 10
_OF_MOTION = 0.01
"""What a base may be off by before anything is known of it, as a share of how far a patch has moved."""
_MEDIAN = 0.789
"""Median of chi-square(3) / 3."""


@dataclass(frozen=True)
class Evidence:
    """One episode's numbers; K patches, F compared frames."""

    name: str
    frames: np.ndarray
    """Compared frames, [F]."""
    residual: np.ndarray
    """[F, K, 3] [m]; 0 where a patch could not be seen, and so are its responses."""
    motion: np.ndarray
    """Measured displacement of the patches, [F, K, 3] [m]."""
    noise_m: np.ndarray
    """Standard deviation of one coordinate of the measurement, [K] [m]."""
    responses: dict[str, np.ndarray]
    """Column -> response of one unit of the amplitude, [F, K, 3] [m]."""
    block: np.ndarray
    """Part of the object in which each patch starts, [K], 0 .. BLOCKS-1: patches of one part err together."""
    spread_m: np.ndarray
    """Standard deviation of one coordinate between the base's predictions, [F, K] [m]; 0 where it has but one."""

    @property
    def doubt_m(self) -> np.ndarray:
        """How unsure the base is: what its misfit is a function of, [F, K] [m].

        Where it has but one prediction this is a measure of how far a patch has moved.
        """
        return np.hypot(self.spread_m, _OF_MOTION * np.linalg.norm(self.motion, axis=-1))

    @property
    def seen(self) -> np.ndarray:
        """Whether a patch could be seen, [F, K]."""
        return (self.residual != 0).any(-1)


def compared_frames(count: int) -> np.ndarray:
    """Choose the frames to compare among `count`, the first left out; shape [F]."""
    return np.unique(np.linspace(1, count - 1, min(FRAMES, count - 1)).round().astype(int))


def evidence_of(episode: Episode, predictions: Sequence[np.ndarray], responses: dict[str, np.ndarray]) -> Evidence:
    """Reduce point trajectories to patches and compared frames.

    Args:
        episode: The measurement.
        predictions: Of the base, [T, M, 3] [m] each; their mean is what it says.
        responses: Column -> change of the prediction by one unit, [T, M, 3] [m].
    """
    frames = compared_frames(len(episode.times))

    seen = episode.seen_patches[frames][..., None]

    def reduced(values: np.ndarray) -> np.ndarray:
        return episode.pooled((values - values[:1])[frames])

    residual = seen * reduced(episode.points - np.mean(predictions, 0))
    scatter = _scatter([reduced(points) for points in predictions])
    return Evidence(
        episode.name,
        frames,
        residual,
        reduced(episode.points),
        episode.patch_noise_m,
        {key: seen * reduced(value) for key, value in responses.items()},
        octants(episode.pooled(episode.points[0])),
        scatter,
    )


def _scatter(predictions: Sequence[np.ndarray]) -> np.ndarray:
    """Standard deviation of one coordinate, [N] x [F, K, 3] -> [F, K]; 0 for a single one."""
    if len(predictions) < 2:
        return np.zeros(predictions[0].shape[:-1])
    return np.asarray(np.sqrt(np.var(predictions, axis=0, ddof=1).mean(-1)))


def octants(centers: np.ndarray) -> np.ndarray:
    """Divide places into eight parts about their median, [K, 3] -> [K]."""
    return ((centers > np.median(centers, 0)) @ [1, 2, 4]).astype(int)


@dataclass(frozen=True)
class MisfitModel:
    """How far the base is off where nothing is missing: standard deviation over how unsure it is."""

    doubt_m: np.ndarray
    """Upper ends of the bins of `Evidence.doubt_m`, [B] [m]."""
    misfit_m: np.ndarray
    """Standard deviation of one coordinate beyond the measurement's noise, [B] [m]."""

    @classmethod
    def of(cls, episodes: list[Evidence]) -> MisfitModel:
        """Estimate from episodes, robustly: half of each bin's residuals are below its estimate's median.

        The misfit may not fall as the doubt grows. What could not be seen does not count.
        """
        doubt = np.concatenate([e.doubt_m[e.seen] for e in episodes])
        excess = np.concatenate([((e.residual**2).mean(-1) / _MEDIAN - e.noise_m**2)[e.seen] for e in episodes])
        if not len(doubt):
            return cls(np.zeros(1), np.zeros(1))
        edges = np.quantile(doubt, np.linspace(0, 1, _BINS + 1))
        found = []
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            inside = excess[(doubt >= low) & (doubt <= high)]
            found.append(max(float(np.median(inside)), 0.0))
        return cls(edges[1:], np.sqrt(np.maximum.accumulate(found)))

    def at(self, doubt_m: np.ndarray) -> np.ndarray:
        """Give the misfit where the base is so unsure, [...] -> [...] [m]."""
        return self.misfit_m[np.minimum(np.searchsorted(self.doubt_m, doubt_m), len(self.misfit_m) - 1)]

    def sigma(self, evidence: Evidence) -> np.ndarray:
        """Expected standard deviation of each residual, [F, K, 1] [m]."""
        return np.sqrt(self.at(evidence.doubt_m) ** 2 + evidence.noise_m**2)[..., None]


@dataclass(frozen=True)
class Whitened:
    """One episode in units of its expected residual, as a row vector and a matrix; D numbers, C columns."""

    name: str
    residual: np.ndarray
    """[D]."""
    matrix: np.ndarray
    """[C, D]."""
    shape: tuple[int, int]
    """Frames and patches, D = frames * patches * 3."""
    block: np.ndarray
    """See Evidence."""

    @property
    def count(self) -> int:
        """How many numbers were measured; what could not be seen is 0 and does not count."""
        return max(1, int(np.count_nonzero(self.residual)))

    def by_block(self, values: np.ndarray) -> np.ndarray:
        """Sum values [D] over each part of the object, [BLOCKS]."""
        per_patch = values.reshape(*self.shape, 3).sum((0, 2))
        return np.bincount(self.block, weights=per_patch, minlength=BLOCKS)

    def flipped(self, signs: np.ndarray) -> Whitened:
        """Change the sign of the residual in some parts of the object; signs [BLOCKS]."""
        field = self.residual.reshape(*self.shape, 3) * signs[self.block][:, None]
        return replace(self, residual=field.ravel())

    def mirrored(self, signs: np.ndarray) -> Whitened:
        """Change the sign of some components of the residual everywhere; signs [3]."""
        return replace(self, residual=(self.residual.reshape(-1, 3) * signs).ravel())


def whiten(evidence: Evidence, misfit: MisfitModel, columns: list[str]) -> Whitened:
    """Divide by the expected standard deviation."""
    sigma = misfit.sigma(evidence)
    rows = [(evidence.responses[key] / sigma).ravel() for key in columns]
    return Whitened(evidence.name, (evidence.residual / sigma).ravel(), np.stack(rows), sigma.shape[:2], evidence.block)


def corrected(evidence: Evidence, columns: list[str], values: np.ndarray) -> Evidence:
    """Take a mixture of responses off the residual: what the base is known to miss."""
    known = np.zeros_like(evidence.residual)
    for key, value in zip(columns, values, strict=True):
        known = known + value * evidence.responses[key]
    return replace(evidence, residual=evidence.residual - known)
