"""Which fault explains which: the order of causes, and warnings that know theirs."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum


class Cause(IntEnum):
    """What a fault of the data lies in; one further up makes those further down appear.

    A wrong clock picks wrong pictures and poses, wrong extrinsics tear the cameras' tables and objects apart, depth
    and masks are judged in the world that both make, and a tool seems to stay away from an object that is misplaced.
    """

    CLOCK = 1
    PICTURES = 2
    INTRINSICS = 3
    EXTRINSICS = 4
    DEPTH = 5
    MASKS = 6
    TOOL = 7
    TOUCH = 8


class Noticed(str):
    """A warning that knows what the fault lies in: a string for everybody else.

    Args:
        text: What was noticed, as it is printed.
        cause: What the fault lies in; None explains nothing that comes later.
        fix: What to do where it turns out to be the first cause of a refusal, one sentence or more.
    """

    cause: Cause | None
    fix: str

    def __new__(cls, text: str, cause: Cause | None = None, fix: str = "") -> Noticed:
        """Make one; a string's value is set here, not in __init__."""
        made = super().__new__(cls, text)
        made.cause, made.fix = cause, fix
        return made


def by_cause(warnings: Iterable[str]) -> list[str]:
    """Sort warnings by what explains what; those without a cause last, equals in the order given."""
    return sorted(dict.fromkeys(warnings), key=lambda text: getattr(text, "cause", None) or len(Cause) + 1)
