"""What the base misses, as a random field with memory, and chance: the covariance of all residuals.

For episode e, at patch p and compared frame t, in three coordinates,

    r_e(p, t) = B_e(p, t) b + m_e(p, t) u_e(place, tool-relative place, phase) + noise

    B b   the base's own parameters, refitted under a prior, and a smooth field: the same in all episodes
    u     a Gaussian process; between episodes it is correlated as their tool paths resemble each other, so that a
          repeated motion shows nearly the same discrepancy and an unlike one tells nothing of it (Kennedy & O'Hagan,
          J. R. Statist. Soc. B 63, 2001)
    m     how far the patch moves: a base errs in proportion to the motion
    noise Student-t per patch and frame, as a scale mixture of Gaussians: where a part breaks loose or starts to slide
          a trajectory is chaotic, and squared error would let it decide everything (Lange et al., JASA 84, 1989).
          What u is too smooth to follow is noise, too, but a repeated motion shows it again, see `noise`

u is kept in inducing features, so that all is linear algebra on some hundred numbers. Nothing here knows which episodes
are to be explained: dealing the episodes out anew changes none of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.cluster.vq import kmeans2

from plop.diagnosis.evidence.contrast import Products
from plop.diagnosis.evidence.evidence import Evidence
from plop.diagnosis.evidence.noise import Leftover, Noise, Scales, repeats_of

FEATURES = 24
"""Inducing points of the field."""
_PLACE, _TOOL, _PHASE = 0.6, 1.0, 0.4
"""Correlation lengths of the field: over the object and relative to the tool [object sizes], over the motion [-]."""
_SLOWER = 0.3
"""Distance between a motion and the same one e times slower [object sizes]."""
_STILL = 0.2
"""Share of how far the object moves on average that counts as motion of a patch that lies still."""
_ROUNDS = 4
"""Rounds in which weights and field are found from each other."""


@dataclass(frozen=True)
class Spread:
    """How large each part is. Half or twice of each changes no ranking of the benchmark; see `Field` for the model."""

    share: float = 0.06
    """Standard deviation of the field, as a share of the motion [-]."""
    reach: float = 0.3
    """Distance of tool paths over which the field keeps its values [object sizes]."""
    repeat: float = 0.97
    """Share of the field's variance that the same motion shows again [-]."""
    rough: float = 0.002
    """Scale of what the field does not follow, beside the measurement's noise [object sizes]."""


SPREAD = Spread()


class Field:
    """The inverse covariance of all residuals: everything that is asked of it is exact."""

    def __init__(self, episodes: Sequence[Evidence], base: Sequence[np.ndarray], spread: Spread = SPREAD) -> None:
        """Find the weights of the noise, and factor the model.

        Args:
            episodes: All of them; E.
            base: Responses of the base's own parameters to one standard deviation of their prior, [F, K, 3, P] each.
            spread: How large each part is.
        """
        self.episodes = list(episodes)
        features = inducing_features(episodes)
        size = np.sqrt(np.mean(np.concatenate([(e.residual**2)[e.seen].ravel() for e in episodes])))
        self._smooth = [size * f for f in features]
        self.unknown = [np.kron(f, np.eye(3)) for f in self._smooth]
        """A smooth field of displacements as large as the residuals, columns [3 F K, 3 M] of each episode."""
        self._base = [
            np.concatenate([columns.reshape(e.residual.size, -1), field], 1)
            for columns, e, field in zip(base, episodes, self.unknown, strict=True)
        ]
        self._local = [spread.share * _motion(e)[:, None] * f for e, f in zip(episodes, features, strict=True)]
        distances = path_distances([e.tool_path for e in episodes], [e.duration_s for e in episodes])
        kernel = spread.repeat * np.exp(-0.5 * (distances / spread.reach) ** 2)
        kernel += (1 - spread.repeat) * np.eye(len(episodes))
        self._inverse_kernel = np.linalg.inv(kernel)
        scales = Scales.of(self.episodes, spread.rough, kernel, repeats_of(distances))
        self.groups = scales.groups
        self.repeats = np.zeros((len(episodes), len(episodes)))
        """1 where two episodes repeat a motion, else 0, [E, E]."""
        for group in self.groups:
            self.repeats[np.ix_(group, group)] = 1.0
        self._weigh(scales.noise(None))
        for _ in range(_ROUNDS):
            self._weigh(scales.noise(self._leftovers()))

    def _weigh(self, noise: Noise) -> None:
        """Take the noise, and factor the model."""
        self.noise = noise
        count, size = len(self.episodes), self._local[0].shape[1]
        precision = np.zeros((count, size, count, size))
        for k in range(size):
            precision[:, k, :, k] = self._inverse_kernel
        for e, local in enumerate(self._local):
            for f, weights in noise.inverse[e].items():
                precision[e, :, f, :] += local.T @ (weights[:, None] * self._local[f])
        self._covariance = np.linalg.inv(precision.reshape(count * size, count * size))
        self._base_left = self._without_field(self._base)
        seen = sum(b.T @ left for b, left in zip(self._base, self._base_left, strict=True))
        self._base_covariance = np.linalg.inv(np.eye(self._base[0].shape[1]) + seen)

    def _without_field(self, columns: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Apply the inverse covariance of noise and field to columns [3 F K, X] of each episode."""
        return self._weighted([x - f for x, f in zip(columns, self._in_field(columns), strict=True)])

    def _in_field(self, columns: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Give the part of columns [3 F K, X] of each episode that the model takes for its field."""
        weighted = [x.reshape(len(f), -1) for x, f in zip(self._weighted(columns), self._local, strict=True)]
        means = self._covariance @ np.concatenate([f.T @ x for f, x in zip(self._local, weighted, strict=True)])
        parts = means.reshape(len(columns), -1, weighted[0].shape[1])
        return [(f @ part).reshape(x.shape) for f, part, x in zip(self._local, parts, columns, strict=True)]

    def _weighted(self, columns: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Apply the inverse covariance of the noise to columns [3 F K, X] of each episode."""
        wide = [x.reshape(len(x) // 3, -1) for x in columns]
        found = [sum(w[:, None] * wide[f] for f, w in row.items()) for row in self.noise.inverse]
        return [np.asarray(each).reshape(x.shape) for each, x in zip(found, columns, strict=True)]

    def products(self, responses: Sequence[Sequence[np.ndarray]], residuals: Sequence[np.ndarray]) -> list[Products]:
        """Multiply responses and residuals with the inverse covariance.

        Args:
            responses: For each hypothesis, what it changes in every episode, [F, K, 3] [m] each.
            residuals: Of every episode, [F, K, 3] [m].
        """
        gram, onto = self.multiplied(columns_of(responses), residuals)
        return [Products(gram[:, k, :, k], onto[:, k], self.repeats) for k in range(len(responses))]

    def multiplied(
        self, columns: Sequence[np.ndarray], residuals: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Multiply columns of every episode with each other and with the residuals, over the covariance.

        Args:
            columns: [3 F K, X] of each episode.
            residuals: [F, K, 3] [m] of each.

        Returns:
            Products of columns [E, X, E, X], and with the residuals [E, X].
        """
        count, wide = len(residuals), columns[0].shape[1]
        left = self._without_field([residual.reshape(-1, 1) for residual in residuals])
        onto = np.stack([r.T @ x[:, 0] for r, x in zip(columns, left, strict=True)])
        seen = [self._seen_by_field(e, each) for e, each in enumerate(columns)]
        size = self._local[0].shape[1]
        covariance = self._covariance.reshape(count, size, count, size)
        gram = np.zeros((count, wide, count, wide))
        for e, row in enumerate(self.noise.inverse):
            for f, weights in row.items():
                gram[e, :, f] = columns[e].T @ (np.repeat(weights, 3)[:, None] * columns[f])
        for f in range(count):
            # what a column of one episode does, through the field, in every other
            through = {e: sum(covariance[e, :, g] @ own for g, own in seen[f].items()) for e in range(count)}
            for e in range(count):
                for g, own in seen[e].items():
                    gram[e, :, f] -= own.reshape(3 * size, wide).T @ np.reshape(through[g], (3 * size, wide))
        base = np.stack([b.T @ r for b, r in zip(self._base_left, columns, strict=True)])  # E, P, X
        flat_base = base.transpose(1, 0, 2).reshape(base.shape[1], count * wide)
        fitted = self._base_covariance @ sum(b.T @ x for b, x in zip(self._base, left, strict=True))
        gram -= (flat_base.T @ self._base_covariance @ flat_base).reshape(gram.shape)
        return gram, onto - np.einsum("epx,p->ex", base, fitted[:, 0])

    def _seen_by_field(self, e: int, columns: np.ndarray) -> dict[int, np.ndarray]:
        """Project weighted columns [3 F K, X] of an episode onto the features of it and its repeats, [M, 3 X] each."""
        wide = columns.reshape(len(columns) // 3, -1)
        return {f: self._local[f].T @ (weights[:, None] * wide) for f, weights in self.noise.inverse[e].items()}

    def _leftovers(self) -> list[Leftover]:
        """Give what is left of the residuals of every episode once the base is refitted."""
        fitted = self.refitted([e.residual for e in self.episodes])
        columns = [each.reshape(-1, 1) for each in fitted]
        field = self._in_field(columns)
        found = []
        for whole, own, smooth, weights in zip(columns, field, self._smooth, self.noise.weights, strict=True):
            whole, own = whole.reshape(-1, 3), own.reshape(-1, 3)
            onto = weights[:, None] * smooth
            hat = np.linalg.solve(smooth.T @ onto + np.eye(smooth.shape[1]), onto.T)
            share = np.einsum("xm,mx->x", smooth, hat)
            rough = (whole - smooth @ (hat @ whole)) / (1 - share)[:, None]  # each left out in turn
            found.append(Leftover(whole, whole - own, rough))
        return found

    def refitted(self, displacements: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Give what the base's own parameters leave, fitted to all episodes together.

        Args:
            displacements: Of every episode, [F, K, 3] [m].
        """
        onto = sum(left.T @ each.reshape(-1) for left, each in zip(self._base_left, displacements, strict=True))
        fitted = self._base_covariance @ onto
        return [each - (b @ fitted).reshape(each.shape) for each, b in zip(displacements, self._base, strict=True)]


def columns_of(responses: Sequence[Sequence[np.ndarray]]) -> list[np.ndarray]:
    """Give the responses of X hypotheses, [F, K, 3] in each episode, as columns [3 F K, X] of each episode."""
    return [np.stack([each.reshape(-1) for each in episode], 1) for episode in zip(*responses, strict=True)]


def inducing_features(episodes: Sequence[Evidence], seed: int = 0) -> list[np.ndarray]:
    """Give the field's features at every patch and frame, [F K, M] for each episode (Nystroem).

    With weights of unit variance they make a field of unit variance where data are.
    """
    places = [_inputs(episode) for episode in episodes]
    together = np.concatenate(places)
    few = np.random.default_rng(seed).choice(len(together), min(3000, len(together)), replace=False)
    centers, _ = kmeans2(together[few], min(FEATURES, len(few)), seed=seed, minit="++")
    root = np.linalg.cholesky(_kernel(centers, centers) + 1e-6 * np.eye(len(centers)))
    return [np.linalg.solve(root, _kernel(centers, place)).T for place in places]


def _inputs(episode: Evidence) -> np.ndarray:
    """Where and when, in correlation lengths, [F K, 7]."""
    frames, patches = episode.seen.shape
    place = np.broadcast_to(episode.place / _PLACE, (frames, patches, 3))
    phase = np.broadcast_to((episode.phase / _PHASE)[:, None, None], (frames, patches, 1))
    return np.concatenate([place, episode.tool_place / _TOOL, phase], -1).reshape(frames * patches, 7)


def _kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    squares = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
    return np.asarray(np.exp(-0.5 * np.maximum(squares, 0)))


def missed2(episode: Evidence, spread: Spread) -> np.ndarray:
    """Squared scale of what a base misses of one coordinate, whether the field follows it or not, [F K] [m^2]."""
    return (spread.rough * episode.size_m) ** 2 + (spread.share * _motion(episode)) ** 2


def _motion(episode: Evidence) -> np.ndarray:
    """How far each patch moves, with a share of how far all do, [F K] [m]."""
    sizes = np.linalg.norm(episode.predicted, axis=-1)
    return np.asarray(np.hypot(sizes, _STILL * np.sqrt((sizes**2).mean(-1, keepdims=True))).reshape(-1))


def path_distances(tool_paths: Sequence[np.ndarray], durations_s: Sequence[float]) -> np.ndarray:
    """Give how unlike the motions of episodes are, [E, E] [object sizes].

    The RMS distance of the tool's corners over the motion, in the object's frame, and how much slower one is.
    """
    paths, slower = np.stack(tool_paths), np.log(durations_s)
    apart = np.sqrt(((paths[:, None] - paths[None]) ** 2).sum(-1).mean((-1, -2)))
    return np.asarray(np.hypot(apart, _SLOWER * np.abs(slower[:, None] - slower)))
