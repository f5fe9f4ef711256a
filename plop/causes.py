"""Causes of faults in the data: their order, and warnings with a known cause."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum


class Cause(IntEnum):
    """Cause of a fault in the data; an earlier cause can produce the symptoms of later ones.

    A wrong clock selects wrong images and poses, wrong extrinsics separate the tables and objects of the cameras, depth
    and masks are checked in the resulting world frame, and a tool appears to miss an object that is misplaced.
    """

    CLOCK = 1
    PICTURES = 2
    EXTRINSICS = 3
    DEPTH = 4
    MASKS = 5
    TOOL = 6
    TOUCH = 7


class Noticed(str):
    """A warning with its cause; otherwise it behaves as a string.

    Args:
        text: The warning, as it is printed.
        cause: The cause; None explains no later error.
        fix: What to do if this is the first cause of an error, one sentence or more.
    """

    cause: Cause | None
    fix: str

    def __new__(cls, text: str, cause: Cause | None = None, fix: str = "") -> Noticed:
        """Make one; a string's value is set here, not in __init__."""
        made = super().__new__(cls, text)
        made.cause, made.fix = cause, fix
        return made


def by_cause(warnings: Iterable[str]) -> list[str]:
    """Sort warnings by the order of causes; those without a cause last, equal ones in the order given."""
    return sorted(dict.fromkeys(warnings), key=lambda text: getattr(text, "cause", None) or len(Cause) + 1)
