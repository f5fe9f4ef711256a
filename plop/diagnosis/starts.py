"""Where the search for a law's amplitude begins: the amplitude, and the direction, that the recordings ask for.

A response tells little of another amplitude where a law has a threshold. An object that lies still under more friction
slides under less, ever farther the less is left, and with none it slides through whatever it is asked: the response at
one end, scaled down, is none of those on the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plop.diagnosis.candidates import Candidate
from plop.diagnosis.state import State
from plop.diagnosis.together import looked_around


def begun(state: State, candidates: Sequence[Candidate]) -> dict[str, Candidate]:
    """Set the laws that are tried at several amplitudes to the one that leaves least, by key.

    Args:
        state: The evidence, with responses at typical amplitudes.
        candidates: All hypotheses, also those that move nothing at their typical amplitude.

    Returns:
        Only laws that leave less than no law does, and less than at their typical amplitude.
    """
    tried = [c for c in candidates if c.columns[0].key in state.keys and len(c.columns) == 1 and c.columns[0].tried]
    wanted = [(c.columns[0], amplitude) for c in tried for amplitude in (c.columns[0].value, *c.columns[0].tried)]
    answers = iter(state.measure(wanted))
    found = {}
    for candidate in tried:
        column = candidate.columns[0]
        left = {
            amplitude: answer[0] for amplitude in (column.value, *column.tried) if (answer := next(answers)) is not None
        }
        best = min(left, key=lambda amplitude: left[amplitude], default=column.value)
        if best != column.value and left[best] < state.energy:
            found[candidate.key] = _set_to(candidate, best)
    return found


def turned(state: State) -> dict[str, Candidate]:
    """Give the laws that seem to act the other way than they were tried, to be tried that way, by key.

    What sticks does not respond to more friction, however much it would to less: a response is judged in the
    direction in which it is needed.
    """
    found = {}
    for score in state.scores():
        candidate = score.candidate
        column = candidate.columns[0]
        signed = len(candidate.columns) == 1 and column.low < 0 < column.high
        if signed and score.values[0] * column.value < 0:
            found[candidate.key] = _set_to(candidate, -column.value)
    return found


def one_sided(candidate: Candidate) -> Candidate:
    """Keep a law's amplitude on the side on which it was tried: what is not there, toughness say, cannot be taken."""
    (column,) = candidate.columns
    kept = replace(column, low=max(column.low, 0.0)) if column.value > 0 else replace(column, high=0.0)
    return replace(candidate, columns=(kept,))


def searched(state: State, candidates: Sequence[Candidate]) -> dict[str, np.ndarray]:
    """Look for the amplitudes of laws that have several, by key; left out is what makes nothing better.

    Responses along the axes would not do: what lies still under a weak pull says nothing of a strong one.
    """
    found = {
        c.key: looked_around(c.columns, state.left_with)
        for c in candidates
        if len(c.columns) > 1 and all(column.key in state.keys for column in c.columns)
    }
    return {key: values for key, values in found.items() if values is not None}


def _set_to(candidate: Candidate, amplitude: float) -> Candidate:
    return replace(candidate, columns=(replace(candidate.columns[0], value=amplitude),))
