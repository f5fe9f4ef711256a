"""An episode in which the tool never touches the object."""

from __future__ import annotations

from pathlib import Path

from plop.causes import Cause
from plop.errors import PlopError


def no_contact_error(where: str | Path, within_m: float, found: str, fix: str) -> PlopError:
    """Return the common error of all ingests for a tool without contact.

    Args:
        where: File and key of the tool's poses.
        within_m: Largest distance that counts as contact [m].
        found: Smallest distance of the tool, and its frame.
        fix: What may be wrong, without a full stop.
    """
    return PlopError(
        "The tool never touches the object.",
        where=where,
        expected=f"a tool within {1000 * within_m:g} mm of the object in some frame",
        found=found,
        fix=f"{fix}; to keep such episodes (a free fall, an object that sags), use --keep-untouched.",
        cause=Cause.TOUCH,
    )
