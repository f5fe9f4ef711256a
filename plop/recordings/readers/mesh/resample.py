"""Resampling of a mesh sequence in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plop.geometry.pose_track import poses_at
from plop.recordings.readers.mesh.sequence import MeshSequence


def resampled(sequence: MeshSequence, times_s: np.ndarray) -> MeshSequence:
    """Interpolate surface and tool linearly in time; constant before the first frame and after the last.

    Args:
        sequence: The episode.
        times_s: New times, shape [N] [s]; they need not increase strictly where they lie outside the episode.

    Returns:
        The episode with N frames whose `times` are `times_s`; `truth` and rest positions are not changed.
    """
    last = len(sequence.times) - 1
    place = np.interp(times_s, sequence.times, np.arange(last + 1))
    low = np.minimum(place.astype(int), max(last - 1, 0))
    share = (place - low)[:, None, None]
    vertices = (1 - share) * sequence.vertices[low] + share * sequence.vertices[np.minimum(low + 1, last)]
    poses = (
        poses_at(sequence.times, sequence.world_from_tool, times_s)
        if last
        else np.repeat(sequence.world_from_tool, len(times_s), 0)
    )
    return replace(
        sequence,
        times=np.asarray(times_s, float),
        vertices=vertices,
        world_from_tool=poses,
        rest_vertices=sequence.rest,
    )
