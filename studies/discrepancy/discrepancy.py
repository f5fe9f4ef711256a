"""What the base misses, as a random field with memory: residual = features w + responses a + noise.

For episode e, at patch p and compared frame t, in three coordinates,

    r_e(p, t) = m_e(p, t) u_e(place, tool-relative place, phase) + sum_k L_ek(p, t) (b_k + d_ek) + noise

    u     a Gaussian process; between episodes it is correlated as their tool paths resemble each other, so that a
          repeated motion shows nearly the same discrepancy and an unlike one tells nothing (Kennedy & O'Hagan 2001)
    m     how far the patch moves: a base errs in proportion to the motion
    b, d  what a base misses may look like any law of the library, at a small amplitude b that is the same in all
          episodes, and d that differs between them
    noise Student-t per patch and frame, as a scale mixture of Gaussians: chance is heavy-tailed (Lange et al. 1989)

u is kept in M inducing features (Nystroem), so that all is linear algebra on E (3 M + L) numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.cluster.vq import kmeans2

from evidence import Evidence

FREEDOM = 4.0
"""Degrees of freedom of the noise: few enough for a part that breaks loose, and its variance is finite."""
_PLACE, _TOOL, _PHASE = 0.6, 1.0, 0.4
"""Correlation lengths of the field: over the object and relative to the tool [object sizes], over the motion [-]."""
_ROUNDS = 4
"""Rounds in which weights and field are found from each other."""


@dataclass(frozen=True)
class Spread:
    """How large each part of a discrepancy is; fitted on the reference by leaving episodes out."""

    share: float = 0.1
    """Standard deviation of the field, as a share of the motion [-]."""
    reach: float = 0.3
    """Distance of tool paths over which the field keeps its values [object sizes]."""
    repeat: float = 0.97
    """Share of the field's variance that the same motion shows again [-]."""
    scale_m: float = 1e-4
    """Scale of the noise beyond the measurement's own [m]."""
    common: float = 0.3
    """Standard deviation of the law-like part that all episodes have, in typical amplitudes [-]."""
    own: float = 0.1
    """Standard deviation of the law-like part of each episode, in typical amplitudes [-]."""


def inducing_features(episodes: Sequence[Evidence], count: int, seed: int = 0) -> list[np.ndarray]:
    """Give the field's features at every patch and frame.

    Args:
        episodes: All of them; E.
        count: Number of features M.
        seed: Chooses the inducing points.

    Returns:
        For each episode [F K, M]: with weights of unit variance they make a field of unit variance, where data are.
    """
    places = [_inputs(episode) for episode in episodes]
    together = np.concatenate(places)
    few = np.random.default_rng(seed).choice(len(together), min(3000, len(together)), replace=False)
    centers, _ = kmeans2(together[few], count, seed=seed, minit="++")
    root = np.linalg.cholesky(_kernel(centers, centers) + 1e-6 * np.eye(count))
    return [np.linalg.solve(root, _kernel(centers, place)).T for place in places]


def _inputs(episode: Evidence) -> np.ndarray:
    frames, patches = episode.seen.shape
    place = np.broadcast_to(episode.place / _PLACE, (frames, patches, 3))
    phase = np.broadcast_to((episode.phase / _PHASE)[:, None, None], (frames, patches, 1))
    return np.concatenate([place, episode.tool_place / _TOOL, phase], -1).reshape(frames * patches, 7)


def _kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    squares = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
    return np.asarray(np.exp(-0.5 * np.maximum(squares, 0)))


def path_distances(episodes: Sequence[Evidence]) -> np.ndarray:
    """Give how unlike the motions of episodes are, [E, E] [object sizes].

    The RMS distance of the tool's corners over the motion, in the object's frame, and how much slower one is.
    """
    paths = np.stack([e.tool_path for e in episodes])
    slower = np.log([e.duration_s for e in episodes])
    apart = np.sqrt(((paths[:, None] - paths[None]) ** 2).sum(-1).mean((-1, -2)))
    return np.hypot(apart, 0.3 * np.abs(slower[:, None] - slower))


class Evidences:
    """Everything about a set of episodes that does not depend on the spread: features, distances, responses."""

    def __init__(self, episodes: Sequence[Evidence], base: int, like: Sequence[int], count: int = 32) -> None:
        """Prepare.

        Args:
            episodes: References and those to explain; E.
            base: How many of `Evidence.base` there are, P: directions in which the base's parameters may be refitted.
            like: Which columns of `Evidence.responses` stand for law-like discrepancies, L of them.
            count: Number of features of the field.
        """
        self.episodes, self.count, self.base = list(episodes), count, base
        self.features = inducing_features(episodes, count)
        self.apart = path_distances(episodes)
        size = np.sqrt(sum((e.predicted**2).sum() for e in episodes))
        large = np.sqrt(sum((e.responses[..., list(like)] ** 2).sum((0, 1, 2)) for e in episodes)) / size
        self.like = [
            e.responses[..., list(like)].reshape(e.residual.size, len(like)) / np.maximum(large, 1e-9) for e in episodes
        ]
        self.refit = [e.base.reshape(e.residual.size, base) for e in episodes]
        self.residual = [e.residual.reshape(-1) for e in episodes]

    @cached_property
    def moved(self) -> list[np.ndarray]:
        """How far each patch moves, with a share of how far all do, [F K] [m] each."""
        sizes = [np.linalg.norm(e.predicted, axis=-1) for e in self.episodes]
        return [np.hypot(s, 0.2 * np.sqrt((s**2).mean(-1, keepdims=True))).reshape(-1) for s in sizes]

    def noise2(self, spread: Spread) -> list[np.ndarray]:
        """Squared scale of the noise, [F K] [m^2] each: the measurement's, the field's roughness, the ensemble's."""
        return [(spread.scale_m**2 + e.noise_m**2 + e.spread_m**2).reshape(-1) for e in self.episodes]

    def seen(self) -> list[np.ndarray]:
        """Whether each patch was seen, [F K] each."""
        return [e.seen.reshape(-1) for e in self.episodes]


class Field:
    """The Gaussian model of all episodes, given the noise's weights; everything that is asked of it is exact."""

    def __init__(
        self, evidences: Evidences, spread: Spread, weights: Sequence[np.ndarray], more: Sequence[np.ndarray] = ()
    ) -> None:
        """Factor the model once.

        Args:
            evidences: The episodes.
            spread: How large each part is.
            weights: Inverse variance of the noise, [F K] [1/m^2] each; 0 where nothing was seen.
            more: Further columns that all episodes share, [3 F K, A] each, with unit standard deviation.
        """
        own = [spread.own * like for like in evidences.like]
        self.local = [
            np.concatenate([np.kron((spread.share * m)[:, None] * f, np.eye(3)), o], 1)
            for m, f, o in zip(evidences.moved, evidences.features, own, strict=True)
        ]
        self.shared = [
            np.concatenate([refit, spread.common * like, *([] if not len(more) else [more[k]])], 1)
            for k, (refit, like) in enumerate(zip(evidences.refit, evidences.like, strict=True))
        ]
        self.weights = [np.repeat(w, 3) for w in weights]
        count, size = len(self.local), self.local[0].shape[1]
        self.size, field = size, 3 * evidences.count
        kernel = spread.repeat * np.exp(-0.5 * (evidences.apart / spread.reach) ** 2)
        self.kernel = kernel + (1 - spread.repeat) * np.eye(count)
        inverse = np.linalg.inv(self.kernel)
        precision = np.zeros((count, size, count, size))
        for k in range(field):
            precision[:, k, :, k] = inverse
        for k in range(field, size):
            precision[:, k, :, k] = np.eye(count)
        self.grams = [a.T @ (w[:, None] * a) for a, w in zip(self.local, self.weights, strict=True)]
        for k, gram in enumerate(self.grams):
            precision[k, :, k, :] += gram
        self.covariance = np.linalg.inv(precision.reshape(count * size, count * size))
        self._shared_left, self._into_local = self._local_left(self.shared)
        self.shared_covariance = np.linalg.inv(
            np.eye(self.shared[0].shape[1])
            + sum(a.T @ left for a, left in zip(self.shared, self._shared_left, strict=True))
        )

    def _local_left(self, columns: Sequence[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray]:
        """Apply the inverse covariance of noise and local parts to columns [3 F K, X]; and the local parts' means."""
        weighted = [w[:, None] * x for w, x in zip(self.weights, columns, strict=True)]
        means = self.covariance @ np.concatenate([a.T @ x for a, x in zip(self.local, weighted, strict=True)])
        parts = means.reshape(len(columns), self.size, -1)
        left = [
            x - w[:, None] * (a @ part)
            for x, w, a, part in zip(weighted, self.weights, self.local, parts, strict=True)
        ]
        return left, means

    def apply(self, columns: Sequence[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
        """Apply the inverse of the whole covariance.

        Args:
            columns: [3 F K, X] for each episode.

        Returns:
            The same shapes; posterior means of the local parts [E m, X] and of the shared ones [P + L + A, X].
        """
        left, means = self._local_left(columns)
        shared = self.shared_covariance @ sum(a.T @ x for a, x in zip(self.shared, left, strict=True))
        left = [x - a @ shared for x, a in zip(left, self._shared_left, strict=True)]
        return left, means - self._into_local @ shared, shared

    def cavity(self, k: int) -> np.ndarray:
        """Covariance of episode k's local parts and the shared ones, given all other episodes, [m + P.., m + P..]."""
        size, into = self.size, self._into_local[k * self.size : (k + 1) * self.size]
        cross = -into @ self.shared_covariance
        local = self.covariance[k * size : (k + 1) * size, k * size : (k + 1) * size] - cross @ into.T
        joint = np.block([[local, cross], [cross.T, self.shared_covariance]])
        both = np.concatenate([self.local[k], self.shared[k]], 1)
        gram = both.T @ (self.weights[k][:, None] * both)
        found = np.linalg.solve((np.eye(len(joint)) - gram @ joint).T, joint.T).T
        return np.asarray(0.5 * (found + found.T))

    def left_out(self, k: int, applied: Sequence[np.ndarray]) -> LeftOut:
        """Predict episode k from all others.

        Args:
            k: Its number.
            applied: What `apply` gave for the columns.
        """
        covariance, weights = self.cavity(k), self.weights[k]
        both, seen = np.concatenate([self.local[k], self.shared[k]], 1), weights > 0
        mine, onto = applied[k][seen], both.T @ applied[k]
        gram = (mine / weights[seen, None]).T @ mine + onto.T @ covariance @ onto
        inner = both.T @ (weights[:, None] * both)
        spread = np.linalg.slogdet(np.eye(len(inner)) + covariance @ inner)[1] - np.log(weights[seen]).sum()
        errors = applied[k] / np.where(seen, weights, 1)[:, None] + both @ (covariance @ onto)
        variance = np.einsum("na,ab,nb->n", both, covariance, both, optimize=True)
        return LeftOut(gram, float(spread), errors, variance)


@dataclass(frozen=True)
class LeftOut:
    """Columns of an episode, predicted from all other episodes."""

    gram: np.ndarray
    """Products of the prediction errors in units of their covariance, [X, X]."""
    spread: float
    """Log determinant of that covariance."""
    errors: np.ndarray
    """Prediction errors, [3 F K, X]."""
    variance: np.ndarray
    """Variance of the prediction without noise, [3 F K]."""


def noise_weights(
    evidences: Evidences,
    spread: Spread,
    residuals: Sequence[np.ndarray],
    enclosing: Sequence[np.ndarray] = (),
) -> list[np.ndarray]:
    """Find the weights of patches and frames, from what a model that holds every law leaves: none of them favours a law.

    Args:
        evidences: The episodes.
        spread: How large each part is.
        residuals: [3 F K] for each episode.
        enclosing: Responses of all laws, [3 F K, A] each, in units of their largest plausible amplitudes.

    Returns:
        Inverse variances [F K] for each episode; 0 where nothing was seen.
    """
    noise2, seen = evidences.noise2(spread), evidences.seen()
    weights = [np.where(s, 1 / n, 0.0) for s, n in zip(seen, noise2, strict=True)]
    for _ in range(_ROUNDS):
        left, _, _ = Field(evidences, spread, weights, enclosing).apply([r[:, None] for r in residuals])
        squares = [
            ((x.reshape(-1, 3) / np.where(w > 0, w, 1)[:, None]) ** 2).sum(1)
            for x, w in zip(left, weights, strict=True)
        ]
        weights = [
            np.where(s, (FREEDOM + 3) / (FREEDOM * n + q), 0.0) for s, n, q in zip(seen, noise2, squares, strict=True)
        ]
    return weights
