"""Errors of a rollout at tracked points, with the spread of its ensemble there.

The measured quantity is the position of up to 400 surface points that `plop filter` tracks; the predicted one moves
with the Gaussians around the point. Frame 0 is given, and points hidden by the tool are not measured: neither counts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from plop.artifacts.atomic_file import whole
from plop.comparison.gaussian_lineage import follow_gaussians
from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.tracking.episode import Episode
from plop.uncertainty.spread import spread_at


@dataclass(frozen=True)
class PointErrors:
    """One episode's errors; T frames, M points."""

    name: str
    time_s: np.ndarray
    """[T] [s]."""
    error_m: np.ndarray
    """Measured minus predicted position, [T, M, 3] [m]."""
    motion_m: np.ndarray
    """Measured position minus that of frame 0, the error of persistence, [T, M, 3] [m]."""
    spread_m: np.ndarray
    """Spread of one coordinate, [T, M] [m]."""
    counts: np.ndarray
    """Whether a point counts, bool [T, M]."""
    noise_m: float
    """Noise of one measured coordinate [m]."""

    def write(self, path: Path) -> None:
        """Write everything into one NPZ file, whole or not at all."""
        path.parent.mkdir(exist_ok=True)
        with whole(path) as scratch, scratch.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **vars(self))

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read what `write` wrote."""
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: file[key] for key in cls.__dataclass_fields__}
        return cls(**{key: array if array.ndim else array.item() for key, array in arrays.items()})


def point_errors(episode: Episode, frames: Iterable[tuple[Gaussians, np.ndarray]]) -> PointErrors:
    """Compare a rollout with the tracked points.

    Args:
        episode: What was measured.
        frames: The Gaussians of every frame, the first included, and their spread [N] [m].

    Raises:
        PlopError: There are not as many frames as measured ones.
    """
    start, predicted, spread = episode.points[0], [], []
    first: Gaussians | None = None
    for now, apart in frames:
        first = now if first is None else first
        predicted.append(follow_gaussians(first, now, start))
        spread.append(spread_at(first, now, apart, start))
    if len(predicted) != len(episode.times):
        raise PlopError(
            "The rollout and the track differ in length.",
            where=episode.name,
            expected=f"{len(episode.times)} frames",
            found=str(len(predicted)),
            fix="Run `plop filter` and `plop rollout` on the same recordings.",
        )
    counts = np.ones(episode.points.shape[:2], bool) if episode.seen is None else episode.seen.copy()
    counts[0] = False
    return PointErrors(
        episode.name,
        episode.times,
        (episode.points - np.stack(predicted)).astype(np.float32),
        (episode.points - start).astype(np.float32),
        np.stack(spread).astype(np.float32),
        counts,
        episode.noise_m,
    )
