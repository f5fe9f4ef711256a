"""What the field is too smooth to follow: chance in each episode, but for the repeats of its motion.

At one patch and frame the residuals of the G episodes of one motion have the covariance

    S = diag(noise^2) + rough^2 C,    C: how alike the motions are, [G, G], of eigenvectors v and eigenvalues l

In the mean of the repeats (l > 1) what the base misses stays; in their differences (l < 1) the measurement's noise is
left, and a law that is in one of them only. An engine's response to a law is off by a quarter, in shape as in size, so
that a difference is known to no more than a quarter of its own size. Every eigenvector's part is Student-t by itself, a
scale mixture of Gaussians. A motion that is not repeated is a group of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.sparse.csgraph import connected_components

from plop.diagnosis.evidence.evidence import Evidence
from plop.diagnosis.rule import RULE
from plop.statistics.heavy_tails import FREEDOM

_SAME_MOTION = 0.02
"""Distance of tool paths up to which a motion is repeated [object sizes]: what the base misses keeps its values over
more than that, and a robot that repeats, before an object measured anew, stays well below."""
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Noise:
    """The covariance of the noise."""

    inverse: list[dict[int, np.ndarray]]
    """For episode e: the inverse with each episode f of its motion, [F K] [1/m^2]; 0 where nothing was seen."""
    weights: list[np.ndarray]
    """Inverse variance of every episode by itself, [F K] [1/m^2]; 0 where nothing was seen."""


@dataclass(frozen=True)
class Leftover:
    """What is left of the residuals of an episode, [F K, 3] [m] each."""

    whole: np.ndarray
    """With the base refitted."""
    beyond_field: np.ndarray
    """Without what the model takes for its field, too."""
    beyond_smooth: np.ndarray
    """Without a smooth field of the episode's own, each patch and frame left out in turn."""


@dataclass(frozen=True)
class Scales:
    """Squared scales of the noise of all episodes."""

    seen: list[np.ndarray]
    """[F K] each."""
    noise2: list[np.ndarray]
    """Measurement, [F K] [m^2] each."""
    rough2: list[np.ndarray]
    """What repeats of a motion show again, [F K] [m^2] each."""
    groups: list[np.ndarray]
    """Episodes of one motion."""
    kernel: np.ndarray
    """How alike motions are, [E, E]."""

    @classmethod
    def of(
        cls, episodes: Sequence[Evidence], rough: float, kernel: np.ndarray, repeats: Sequence[np.ndarray]
    ) -> Scales:
        """Measure episodes.

        Args:
            episodes: They; repeats of a motion have the same patches.
            rough: Scale of what the field does not follow [object sizes].
            kernel: How alike motions are.
            repeats: Episodes of one motion, see `repeats_of`.
        """
        flat = [np.broadcast_to((e.noise_m**2)[None], e.seen.shape).reshape(-1) for e in episodes]
        rough2 = [(e.spread_m**2 + (rough * e.size_m) ** 2).reshape(-1) for e in episodes]
        groups = [g for every in repeats for g in _with_same_patches(every, episodes)]
        return cls([e.seen.reshape(-1) for e in episodes], flat, rough2, groups, kernel)

    def noise(self, left: Sequence[Leftover] | None = None) -> Noise:
        """Find weights, by what is left of the residuals of every episode."""
        inverse: list[dict[int, np.ndarray]] = [{} for _ in self.seen]
        weights = [
            seen * _weights(noise2 + rough2, None if left is None else left[e].beyond_field)
            for e, (seen, noise2, rough2) in enumerate(zip(self.seen, self.noise2, self.rough2, strict=True))
        ]
        for group in self.groups:
            together, parts = np.all([self.seen[e] for e in group], 0), self._parts(group, left)
            for (i, e), (j, f) in product(enumerate(group.tolist()), repeat=2):
                both = sum(v[i] * v[j] * w for v, w in parts)
                inverse[e][f] = np.where(together, both, weights[e] * (i == j))
        return Noise(inverse, weights)

    def _parts(self, group: np.ndarray, left: Sequence[Leftover] | None) -> list[tuple[np.ndarray, np.ndarray]]:
        """Give eigenvectors of the repeats of a motion, [G], and the inverse variance of what is along them, [F K]."""
        noise2, rough2 = (np.mean([each[e] for e in group], 0) for each in (self.noise2, self.rough2))
        seen = np.all([self.seen[e] for e in group], 0)
        values, vectors = np.linalg.eigh(self.kernel[np.ix_(group, group)])
        found = []
        for value, vector in zip(values, vectors.T, strict=True):
            part, scale2 = None, noise2 + value * rough2
            if left is not None:
                own = [left[e] for e in group]
                if value < 1 - _ROUNDING and seen.any():  # a difference
                    apart = np.tensordot(vector, [each.whole for each in own], 1)
                    scale2 = scale2 + RULE.response_error**2 * float((apart[seen] ** 2).mean())
                    part = np.tensordot(vector, [each.beyond_smooth for each in own], 1)
                else:
                    part = np.tensordot(vector, [each.beyond_field for each in own], 1)
            found.append((vector, _weights(scale2, part)))
        return found


def _weights(scale2: np.ndarray, left: np.ndarray | None) -> np.ndarray:
    """Inverse variance of Student-t noise, given what is left of it, [F K]."""
    if left is None:
        return 1 / scale2
    return np.asarray((FREEDOM + 3) / (FREEDOM * scale2 + (left**2).sum(1)))


def repeats_of(distances: np.ndarray) -> list[np.ndarray]:
    """Find the repeats of every motion, from how far tool paths are apart, [E, E] [object sizes]."""
    count, label = connected_components(distances <= _SAME_MOTION, directed=False)
    return [np.flatnonzero(label == k) for k in range(count)]


def _with_same_patches(group: np.ndarray, episodes: Sequence[Evidence]) -> list[np.ndarray]:
    """Part a group: what has fewer points than patches, or frames, than the first cannot be compared with it."""
    same = np.array([episodes[k].seen.shape == episodes[group[0]].seen.shape for k in group])
    return [group[same], *(np.array([k]) for k in group[~same])]
