"""Without reference recordings: how much a law seems to explain where nothing is hidden, as engines differ."""

from __future__ import annotations


def chance_without_reference(errors: float) -> float:
    """Chance that some law of the library is as many standard errors from zero where nothing is hidden."""
    return 1.0
