"""What `plop calibrate` says of the cameras of a set of recordings, for the stages that use them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from plop.artifacts.layouts import Recordings
from plop.causes import Cause, Noticed

BAD = "bad"


def are_judged(folder: Path) -> bool:
    """Tell whether a set of recordings is one of calibrate's."""
    return Recordings(folder).verdicts.is_file()


def bad_cameras(folder: Path, episode: str) -> dict[str, str]:
    """Give the cameras of an episode that are not usable, each with what to do.

    Args:
        folder: Payload of a set of recordings; one that calibrate did not write holds no verdicts.
        episode: Its name.
    """
    return {
        str(row.get("camera")): str(row.get("fix", ""))
        for row in _verdicts(folder).get(episode, ())
        if not row.get("usable", True)
    }


def only_bad_cameras(folder: Path) -> dict[str, Noticed]:
    """Find the episodes none of whose cameras is fit for use; what is made of them is no better.

    Args:
        folder: Payload of a set of recordings, calibrated or not.

    Returns:
        Per such episode what to say, with the advice for its first camera; nothing where there are no verdicts.
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
    count = "its only camera" if len(verdicts) == 1 else f"all {len(verdicts)} cameras of it"
    return Noticed(
        f"`plop calibrate` calls {count} bad ({verdicts[0].get('camera')}: {fix})",
        Cause.EXTRINSICS,
        f"Mend the cameras first: {fix}.",
    )
