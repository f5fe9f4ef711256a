"""Cameras that a user leaves out, checked before work begins."""

from __future__ import annotations

from collections.abc import Sequence

from plop.errors import PlopError
from plop.recordings.set import RecordingSet


def check_excluded(recordings: RecordingSet, excluded: Sequence[str], stage: str) -> None:
    """Refuse a camera that is not there, and leaving out all of them.

    Raises:
        PlopError: One of the two, by name of the stage's setting `exclude`.
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
                fix="Name cameras as these recordings do.",
            )
    if set(known) <= set(excluded):
        raise PlopError(
            "All cameras are left out.",
            where=where,
            expected="one camera left at least",
            found=", ".join(excluded),
            fix="Leave out fewer.",
        )
