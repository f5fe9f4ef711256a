"""Verdicts of `plop calibrate` on the cameras of a set of recordings, for later stages."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from plop.artifacts.layouts import Recordings
from plop.causes import Cause, Noticed

BAD = "bad"


def are_judged(folder: Path) -> bool:
    """Return whether a set of recordings was written by calibrate."""
    return Recordings(folder).verdicts.is_file()


def bad_cameras(folder: Path, episode: str) -> dict[str, str]:
    """Return the cameras of an episode that are not usable, each with what to do.

    Args:
        folder: Payload of a set of recordings; without verdicts unless calibrate wrote it.
        episode: Its name.
    """
    return {
        str(row.get("camera")): str(row.get("fix", ""))
        for row in _verdicts(folder).get(episode, ())
        if not row.get("usable", True)
    }


def only_bad_cameras(folder: Path) -> dict[str, Noticed]:
    """Find the episodes without a usable camera.

    Args:
        folder: Payload of a set of recordings, calibrated or not.

    Returns:
        Per such episode the message, with the advice for its first camera; empty where there are no verdicts.
    """
    return {
        name: _said(rows)
        for name, rows in _verdicts(folder).items()
        if rows and all(row.get("verdict") == BAD for row in rows)
    }


def _verdicts(folder: Path) -> dict[str, list[dict[str, Any]]]:
    try:
        episodes = json.loads(Recordings(folder).verdicts.read_text(encoding="utf-8"))["episodes"]
        return {name: list(row["cameras"]) for name, row in episodes.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _said(verdicts: list[dict[str, Any]]) -> Noticed:
    fix = str(verdicts[0].get("fix", ""))
    count = "its only camera" if len(verdicts) == 1 else f"all {len(verdicts)} of its cameras"
    return Noticed(
        f"`plop calibrate` calls {count} bad ({verdicts[0].get('camera')}: {fix})",
        Cause.EXTRINSICS,
        f"Repair the cameras first: {fix}.",
    )
