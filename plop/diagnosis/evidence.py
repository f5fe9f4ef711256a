"""Residuals and responses of all episodes, in units of what the base is expected to miss.

    residual = measured - prediction of the base            response = engine with an effect - engine without

Both are displacements of patches of the surface. For the engine as base this is the model's own derivative;
for a learned base the engine supplies only the difference that an effect makes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plop.diagnosis.episode import Episode

FRAMES = 12
"""Frames of an episode that are compared, evenly spaced to its end."""
BLOCKS = 8
"""Parts of an object whose errors count as independent of each other."""
_BINS = 10
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

    @property
    def seen(self) -> np.ndarray:
        """Whether a patch could be seen, [F, K]."""
        return (self.residual != 0).any(-1)


def compared_frames(count: int) -> np.ndarray:
    """Choose the frames to compare among `count`, the first left out; shape [F]."""
    return np.unique(np.linspace(1, count - 1, min(FRAMES, count - 1)).round().astype(int))


def evidence_of(episode: Episode, prediction: np.ndarray, responses: dict[str, np.ndarray]) -> Evidence:
    """Reduce point trajectories to patches and compared frames.

    Args:
        episode: The measurement.
        prediction: Of the base, [T, M, 3] [m].
        responses: Column -> change of the prediction by one unit, [T, M, 3] [m].
    """
    frames = compared_frames(len(episode.times))

    seen = episode.seen_patches[frames][..., None]

    def reduced(values: np.ndarray) -> np.ndarray:
        return episode.pooled((values - values[:1])[frames])

    return Evidence(episode.name, frames, seen * reduced(episode.points - prediction), reduced(episode.points),
                    episode.patch_noise_m, {key: seen * reduced(value) for key, value in responses.items()},
                    octants(episode.pooled(episode.points[0])))  # fmt: skip


def octants(centers: np.ndarray) -> np.ndarray:
    """Divide places into eight parts about their median, [K, 3] -> [K]."""
    return ((centers > np.median(centers, 0)) @ [1, 2, 4]).astype(int)


@dataclass(frozen=True)
class MisfitModel:
    """How far the base is off where nothing is missing: standard deviation over the size of the motion."""

    motion_m: np.ndarray
    """Upper ends of the bins, [B] [m]."""
    misfit_m: np.ndarray
    """Standard deviation of one coordinate beyond the measurement's noise, [B] [m]."""

    @classmethod
    def of(cls, episodes: list[Evidence]) -> MisfitModel:
        """Estimate from episodes, robustly: half of each bin's residuals are below its estimate's median.

        The misfit may not fall as the motion grows. What could not be seen does not count.
        """
        motion = np.concatenate([np.linalg.norm(e.motion, axis=-1)[e.seen] for e in episodes])
        excess = np.concatenate([((e.residual**2).mean(-1) / _MEDIAN - e.noise_m**2)[e.seen] for e in episodes])
        if not len(motion):
            return cls(np.zeros(1), np.zeros(1))
        edges = np.quantile(motion, np.linspace(0, 1, _BINS + 1))
        found = []
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            inside = excess[(motion >= low) & (motion <= high)]
            found.append(max(float(np.median(inside)), 0.0))
        return cls(edges[1:], np.sqrt(np.maximum.accumulate(found)))

    def of_motion(self, motion: np.ndarray) -> np.ndarray:
        """Give the misfit for displacements, [..., 3] -> [...] [m]."""
        size = np.linalg.norm(motion, axis=-1)
        return self.misfit_m[np.minimum(np.searchsorted(self.motion_m, size), len(self.misfit_m) - 1)]

    def sigma(self, evidence: Evidence) -> np.ndarray:
        """Expected standard deviation of each residual, [F, K, 1] [m]."""
        return np.sqrt(self.of_motion(evidence.motion) ** 2 + evidence.noise_m**2)[..., None]


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


def whiten(evidence: Evidence, misfit: MisfitModel, columns: list[str]) -> Whitened:
    """Divide by the expected standard deviation."""
    sigma = misfit.sigma(evidence)
    rows = [(evidence.responses[key] / sigma).ravel() for key in columns]
    return Whitened(evidence.name, (evidence.residual / sigma).ravel(), np.stack(rows),
                    sigma.shape[:2], evidence.block)  # fmt: skip


def corrected(evidence: Evidence, columns: list[str], values: np.ndarray) -> Evidence:
    """Take a mixture of responses off the residual: what the base is known to miss."""
    known = np.zeros_like(evidence.residual)
    for key, value in zip(columns, values, strict=True):
        known = known + value * evidence.responses[key]
    return replace(evidence, residual=evidence.residual - known)
