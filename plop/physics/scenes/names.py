"""Check of names given by the user, with a suggestion when one is unknown."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from plop.errors import PlopError


def one_of(name: str, known: Iterable[str], what: str, *, where: str) -> str:
    """Return the name when it is known.

    Args:
        name: The name given by the user.
        known: All names.
        what: What it names, for the message, e.g. "motion".
        where: Key or file that contains it.

    Raises:
        PlopError: It is unknown; suggests the nearest.
    """
    names = list(known)
    if name not in names:
        near = get_close_matches(str(name), names, 1)
        raise PlopError(
            f"There is no such {what}.",
            where=where,
            expected=", ".join(names),
            found=str(name),
            fix=f"Did you mean {near[0]}?" if near else f"Choose one of the {what}s above.",
        )
    return name
