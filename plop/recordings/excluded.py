"""Cameras that a user leaves out, checked before work begins."""

from __future__ import annotations

from collections.abc import Sequence

from plop.errors import PlopError
from plop.recordings.set import RecordingSet


def check_excluded(recordings: RecordingSet, excluded: Sequence[str], stage: str) -> None:
    """Reject an unknown camera, and the exclusion of all cameras.

    Raises:
        PlopError: One of the two; names the stage's setting `exclude`.
    """
    if not excluded:
        return
    with recordings.open(recordings.names[0]) as first:
        known = first.camera_names
    where = f"{stage}.exclude"
    for name in excluded:
        if name not in known:
            raise PlopError(
                "There is no such camera.",
                where=where,
                expected=", ".join(known),
                found=name,
                fix="Use the names of the cameras in these recordings.",
            )
    if set(known) <= set(excluded):
        raise PlopError(
            "All cameras are excluded.",
            where=where,
            expected="at least one remaining camera",
            found=", ".join(excluded),
            fix="Exclude fewer cameras.",
        )
