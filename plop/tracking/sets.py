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
"""Largest distance to the object of a tool that may have touched it [m]."""


def tracked_episodes(
    recordings: RecordingSet, init: Path, tracks: Path, names: list[str], *, seed: int = 0
) -> tuple[list[Episode], dict[str, str]]:
    """Read episodes; unusable ones are left out with the reason.

    Args:
        recordings: The set.
        init: Payload of `fit-init`.
        tracks: Payload of `filter`.
        names: Names of the episodes.
        seed: Seed of the choice of points.

    Raises:
        PlopError: None is usable.
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
    """Reject a motion without contact: it is not informative about the object.

    Raises:
        PlopError: The tool never touches the object.
    """
    nearest = min(
        float(tool_distance(episode.tool, frame, places).min()) for frame, places in enumerate(episode.points)
    )
    if nearest > NEVER_NEAR_M:
        raise PlopError(
            "The tool never touches the object.",
            where=episode.name,
            expected="contact in at least one frame",
            found=f"{1000 * nearest:.0f} mm at the closest",
            fix="Leave this episode out, or check the tool's pose.",
        )
