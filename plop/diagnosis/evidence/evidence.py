"""One episode's numbers, as the discrepancy model and the hypotheses take them; K patches, F compared frames.

    residual = measured - prediction of the base            response = engine with a law - engine without

Both are displacements of patches of the surface. For the engine as base a response is the model's own; for a learned
base the engine supplies only the difference that a law makes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from trimesh import Trimesh

from plop.tracking.episode import Episode

FRAMES = 12
"""Frames of an episode that are compared, evenly spaced to its end."""
PATH_STEPS = 20
"""Places of the tool by which motions are compared, evenly spaced over the motion."""


@dataclass(frozen=True)
class Evidence:
    """Residuals of one episode, and where and when they are; lengths without unit are in units of the object's size."""

    name: str
    size_m: float
    """Largest edge of the object's box [m]."""
    frames: np.ndarray
    """Compared frames, [F]."""
    residual: np.ndarray
    """[F, K, 3] [m]; 0 where a patch could not be seen."""
    predicted: np.ndarray
    """Displacement that the base predicts, [F, K, 3] [m]."""
    noise_m: np.ndarray
    """Standard deviation of one coordinate of the measurement, [K] [m]."""
    spread_m: np.ndarray
    """Standard deviation of one coordinate between the base's predictions, [F, K] [m]; 0 where it has but one."""
    seen: np.ndarray
    """Whether a patch could be seen, bool [F, K]."""
    place: np.ndarray
    """Of the patches at the first frame, from the middle of the object's foot, [K, 3] [-]."""
    tool_place: np.ndarray
    """Of the patches in the tool's frame, [F, K, 3] [-]."""
    phase: np.ndarray
    """Share of the motion that is over, [F] [-]."""
    tool_path: np.ndarray
    """Corners of the tool's box over the motion, from the middle of the object's foot, [PATH_STEPS, 8, 3] [-]."""
    duration_s: float

    @property
    def variance_m2(self) -> np.ndarray:
        """Squared scale of what is chance: measurement noise, and the scatter of predictions, [F, K] [m^2]."""
        return np.asarray(self.noise_m**2 + self.spread_m**2)


def compared_frames(count: int) -> np.ndarray:
    """Choose the frames to compare among `count`, the first left out; shape [F]."""
    return np.unique(np.linspace(1, count - 1, min(FRAMES, count - 1)).round().astype(int))


def evidence_of(episode: Episode, predictions: Sequence[np.ndarray]) -> Evidence:
    """Reduce point trajectories to patches and compared frames.

    Args:
        episode: The measurement.
        predictions: Of the base, [T, M, 3] [m] each; their mean is what it says.
    """
    frames = compared_frames(len(episode.times))
    seen = episode.seen_patches[frames]
    each = [moved(episode, points) for points in predictions]
    predicted = np.mean(each, 0)
    size = size_of(episode)
    foot = foot_of(episode)
    poses = episode.tool.world_from_tool
    now = episode.pooled(episode.points[0]) + predicted
    places = [(points - pose[:3, 3]) @ pose[:3, :3] for points, pose in zip(now, poses[frames], strict=True)]
    return Evidence(
        episode.name,
        size,
        frames,
        seen[..., None] * (moved(episode, episode.points) - predicted),
        predicted,
        episode.patch_noise_m,
        _scatter(each),
        seen,
        (episode.pooled(episode.points[0]) - foot) / size,
        np.stack(places) / size,
        frames / (len(episode.times) - 1),
        tool_path(episode),
        float(episode.times[-1] - episode.times[0]),
    )


def moved(episode: Episode, points: np.ndarray) -> np.ndarray:
    """Average displacements since the first frame over patches at the compared frames, [T, M, 3] -> [F, K, 3]."""
    return episode.pooled((points - points[:1])[compared_frames(len(episode.times))])


def size_of(episode: Episode) -> float:
    """Give the longest side of the object at the start [m]."""
    return float(np.ptp(episode.vertices, axis=0).max())


def foot_of(episode: Episode) -> np.ndarray:
    """Give the middle of the object's surface at the start, at the height of its lowest point, [3] [m].

    It does not depend on where a mesh has many vertices: the same object, measured again, has another mesh.
    """
    surface = Trimesh(episode.vertices, episode.faces, process=False)
    return np.array([*surface.centroid[:2], episode.vertices[:, 2].min()])


def tool_path(episode: Episode) -> np.ndarray:
    """Corners of the tool's box at evenly spaced times, from the object's foot, [PATH_STEPS, 8, 3] [object sizes]."""
    low, high = episode.tool.vertices.min(0), episode.tool.vertices.max(0)
    corners = np.array(list(product(*zip(low, high, strict=True))))
    steps = np.linspace(0, len(episode.times) - 1, PATH_STEPS).round().astype(int)
    poses = episode.tool.world_from_tool[steps]
    at = corners @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    return np.asarray((at - foot_of(episode)) / size_of(episode))


def _scatter(predictions: Sequence[np.ndarray]) -> np.ndarray:
    """Standard deviation of one coordinate, [N] x [F, K, 3] -> [F, K]; 0 for a single one."""
    if len(predictions) < 2:
        return np.zeros(predictions[0].shape[:-1])
    return np.asarray(np.sqrt(np.var(predictions, axis=0, ddof=1).mean(-1)))
