"""All episodes of a set of recordings that have a track."""

from __future__ import annotations

from pathlib import Path

from plop.artifacts.layouts import Fits, Tracks
from plop.errors import PlopError
from plop.recordings.set import RecordingSet
from plop.tracking.episode import Episode
from plop.tracking.hidden_points import tool_distance
from plop.tracking.tracks import episode_from_track

NEVER_NEAR_M = 0.02
"""Farther than this from the object all the time, a tool has not touched it [m]."""


def tracked_episodes(
    recordings: RecordingSet, init: Path, tracks: Path, names: list[str], *, seed: int = 0
) -> tuple[list[Episode], dict[str, str]]:
    """Read episodes; one that cannot be used is left out with the reason.

    Args:
        recordings: The set.
        init: Payload of `fit-init`.
        tracks: Payload of `filter`.
        names: Episodes wanted.
        seed: Chooses the followed points.

    Raises:
        PlopError: None can be used.
    """
    found, left_out = [], {}
    for name in names:
        try:
            episode = episode_from_track(
                recordings.path(name), Fits(init).episode(name).object_splat, Tracks(tracks).states(name), seed=seed
            )
            check_touch(episode)
            found.append(episode)
        except PlopError as error:
            left_out[name] = f"{error.problem} {error.found or ''}".strip()
    if not found:
        raise PlopError(
            "No episode can be compared.",
            where=recordings.folder,
            found=str(left_out)[:400],
            fix="Run `plop fit-init` and `plop filter` on these recordings.",
        )
    return found, left_out


def check_touch(episode: Episode) -> None:
    """Refuse a motion that never touches the object: it says nothing about it.

    Raises:
        PlopError: The tool stays away.
    """
    nearest = min(
        float(tool_distance(episode.tool, frame, places).min()) for frame, places in enumerate(episode.points)
    )
    if nearest > NEVER_NEAR_M:
        raise PlopError(
            "The tool never touches the object.",
            where=episode.name,
            expected="contact in at least one frame",
            found=f"{1000 * nearest:.0f} mm at the nearest",
            fix="Leave this episode out, or check the tool's pose.",
        )
