"""Kinds of motion within which episodes are compared with the reference's."""

from __future__ import annotations

from collections.abc import Sequence

_LEAST_DEGREES = 4
"""Degrees of freedom within kinds of motion below which kinds are not told apart."""


def told_apart(strata: tuple[Sequence[str], Sequence[str]]) -> bool:
    """Tell whether there are kinds to compare within."""
    return bool(set(strata[0]) - {""})


def strata_of(here: Sequence[str], reference: Sequence[str]) -> tuple[list[str], list[str]]:
    """Name the kinds that both sets have, and all others ""; only "" where kinds cannot be told apart.

    That is where nothing compares with what has no counterpart, or where hardly two episodes are of one kind.
    """
    one = [""] * len(here), [""] * len(reference)
    both = set(here) & set(reference)
    found = [[kind if kind in both else "" for kind in kinds] for kinds in (here, reference)]
    alone = [("" in kinds) for kinds in found]
    cells = {(side, kind) for side, kinds in enumerate(found) for kind in kinds if kind in found[0]}
    repeats = sum(kind in found[0] for kinds in found for kind in kinds) - len(cells)
    if (alone[0] and not alone[1]) or repeats < _LEAST_DEGREES:
        return one
    return (found[0], found[1]) if len(set(found[0])) > 1 else one
