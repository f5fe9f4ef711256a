"""Choose the camera that shows most of the interaction, for pictures and videos."""

from __future__ import annotations

import numpy as np

from plop.errors import PlopError
from plop.recordings.recording import Recording


def busiest_camera(recording: Recording, wanted: str = "") -> str:
    """Name the camera whose image changes most between the first and the last frame.

    Args:
        recording: The episode.
        wanted: Use this camera instead, when not empty.

    Returns:
        Name of a camera; the first by name among equals.

    Raises:
        PlopError: There is no camera, or not the requested one.
    """
    check_camera(recording, wanted)
    if wanted:
        return wanted

    def change(name: str) -> float:
        first, last = (recording.view(name, frame).rgb.astype(np.float32) for frame in (0, len(recording) - 1))
        return float(np.abs(last - first).mean())

    return max(recording.camera_names, key=change)


def check_camera(recording: Recording, wanted: str = "") -> None:
    """Reject a camera that a recording does not have.

    Args:
        recording: The episode.
        wanted: The camera; any when empty.

    Raises:
        PlopError: There is no camera, or not the requested one.
    """
    names = recording.camera_names
    if not names or (wanted and wanted not in names):
        raise PlopError(
            "There is no such camera.",
            where=recording.path,
            expected=", ".join(names) or "any camera",
            found=wanted or "no camera in the recording",
            fix="Choose one of these, or omit the option.",
        )
