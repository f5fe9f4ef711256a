"""The two baselines of every table: nothing moves, and the best rigid motion.

*persistence* keeps frame 0's Gaussians where they are. *rigid* moves them as one body with the
pose that best fits the **measured** cloud of each frame. It uses the measurement, which a
prediction must not: it is an oracle, an upper bound for rigid predictions, and not a method.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from plop.geometry.rigid import invert_rigid, kabsch, transform_points

_SAMPLE_POINTS = 1024
_ROUNDS = 40
_STOP_M = 1e-6


class RigidFit:
    """Fit one cloud rigidly onto others.

    The nearest points of a sample of each cloud are found among all points of the other, both
    ways, so that the fit lowers the two-sided distance that CD measures.

    Args:
        source: Cloud to move, shape [A, 3], metres.
        seed: Seed of the samples.
    """

    def __init__(self, source: np.ndarray, seed: int = 0) -> None:
        self._random = np.random.default_rng(seed)
        self._source = source
        self._tree = cKDTree(source)
        self._sample = self._draw(source)

    def best(self, target: np.ndarray, starts: list[np.ndarray]) -> np.ndarray:
        """Find the rigid transform that brings the source closest to a target.

        Iterative closest points from every start; returns the transform with the lowest CD.

        Args:
            target: Shape [B, 3], metres.
            starts: Transforms to start from, shape [4, 4] each; kept when nothing better is found. Shifts along
                the line between the clouds' centres are tried as well.

        Returns:
            Transform from source to target, shape [4, 4].
        """
        offset = target.mean(0) - self._source.mean(0)
        starts = [*starts, *(shifted(offset * times) for times in (1, 2, -1))]
        tree, sample = cKDTree(target), self._draw(target)
        found = [pair for start in starts for pair in self._refine(tree, sample, start)]
        return min(found, key=lambda pair: pair[0])[1]

    def _refine(self, tree: cKDTree, sample: np.ndarray, pose: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """Yield (CD in metres, pose) of every iteration."""
        rounds: list[tuple[float, np.ndarray]] = []
        for _ in range(_ROUNDS):
            forward, at_target = tree.query(transform_points(pose, self._sample))
            backward, at_source = self._tree.query(transform_points(invert_rigid(pose), sample))
            rounds.append((0.5 * float(forward.mean() + backward.mean()), pose))
            if len(rounds) > 1 and rounds[-1][0] > rounds[-2][0] - _STOP_M:
                break
            pose = kabsch(
                np.concatenate([self._sample, self._source[at_source]]), np.concatenate([tree.data[at_target], sample])
            )
        return rounds

    def _draw(self, points: np.ndarray) -> np.ndarray:
        return points[self._random.permutation(len(points))[:_SAMPLE_POINTS]]


def shifted(offset: np.ndarray) -> np.ndarray:
    """Return the transform that moves by an offset, shape [3] -> [4, 4], metres."""
    pose = np.eye(4)
    pose[:3, 3] = offset
    return pose
