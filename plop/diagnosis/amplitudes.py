"""From typical amplitudes of all laws to those of least error, run by run: the rollouts between screen and verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from plop.diagnosis.candidates import Candidate, Column
from plop.diagnosis.profile import STEP, profiles_of
from plop.diagnosis.screen import one_per_effect
from plop.diagnosis.starts import begun, one_sided, searched, turned
from plop.diagnosis.state import State
from plop.diagnosis.table import Table
from plop.diagnosis.together import least_together
from plop.diagnosis.variants import others_of
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import EffectType
from plop.physics.hidden.response import slowdown

REFITTED = 4
"""Effects whose response is computed anew at the amplitude found."""
PROFILED_SHARE = 0.5
"""Least share of the best effect's gain from which an effect may be named, so that its amplitude is looked for."""
_LEAST_SEEN = 0.05
"""Least share of the amplitude at which a response was computed from which it is computed anew."""
SLOWER = 16.0
"""How many times more time steps than without it the engine may take for a law whose amplitude is looked for."""


def of_least_error(
    state: State,
    candidates: list[Candidate],
    begins: Mapping[str, Candidate],
    base: EngineBase,
    types: Mapping[str, EffectType],
) -> tuple[list[Candidate], State]:
    """Move the best laws, and the base's own parameters, to the amplitudes that leave least.

    Args:
        state: The evidence, with every law's response where it begins.
        candidates: The laws there.
        begins: Those that were tried at several amplitudes, by key, see `begun_everywhere`.
        base: The engine.
        types: The library.

    Returns:
        The laws with these amplitudes, and the evidence with the responses there, means over discretisations.
    """
    tables = state.tables
    several = searched(state, candidates)
    candidates = _moved(candidates, several)
    state = _responded(tables, candidates, list(several))
    # what was looked for in rollout is not moved by what responses, taken as proportional, say
    settled = several | {key: np.array([candidate.columns[0].value]) for key, candidate in begins.items()}
    best = _best_values(state)
    candidates = _moved(candidates, {key: values for key, values in best.items() if key not in settled})
    state = _responded(tables, candidates, [key for key in best if key not in settled])
    best = _best_values(state, PROFILED_SHARE)
    best |= {key: values for key, values in settled.items() if key in best}
    best |= others_of(best, state.scores())
    candidates = _moved(candidates, best)
    alone = [c for c in candidates if c.key in best and len(c.columns) == 1]
    profiles = profiles_of([_affordable(c.columns[0], base, types) for c in alone], state.measure)
    least = {c.key: np.array([profiles[c.columns[0].key].least()]) for c in alone if c.columns[0].key in profiles}
    least |= {
        c.key: least_together(c.columns, best[c.key], state.left_with)
        for c in candidates
        if c.key in best and c.key not in several and len(c.columns) > 1
    }
    candidates = _moved(candidates, least)
    state = _responded(tables, candidates, list(best), everywhere=True)
    state.profiles = profiles
    return candidates, state


def begun_everywhere(state: State, candidates: list[Candidate]) -> tuple[list[Candidate], State, dict[str, Candidate]]:
    """Try each law from where it leaves least, then the other way where it seems to act that way.

    Returns:
        The candidates with these amplitudes, the evidence, and the laws that were tried at several amplitudes, by key.
    """
    begins = begun(state, candidates)
    candidates, state = _started(state, candidates, begins)
    others = {key: candidate for key, candidate in turned(state).items() if key not in begins}
    before = {c.key: c for c in candidates}
    candidates, state = _started(state, candidates, others)
    heard = {c.key for c in state.screen.candidates}
    one_way = {key: one_sided(before[key]) for key in others if key not in heard}
    candidates, state = _started(state, candidates, one_way)
    return candidates, state, begins


def _affordable(column: Column, base: EngineBase, types: Mapping[str, EffectType]) -> Column:
    """Limit how far a profile goes: runs with much viscosity, for one, take ever more time steps."""
    value = column.value
    while abs(value) < max(abs(column.low), abs(column.high)):
        value *= STEP
        if slowdown(column.build(types, value), base.material, base.config) > SLOWER:
            ends = sorted((value / STEP, -value / STEP))
            return replace(column, low=max(column.low, ends[0]), high=min(column.high, ends[1]))
    return column


def _started(
    state: State, candidates: list[Candidate], starts: Mapping[str, Candidate]
) -> tuple[list[Candidate], State]:
    """Put some laws, by key, in place of those with typical amplitudes, and compute their responses."""
    if not starts:
        return candidates, state
    candidates = [starts.get(c.key, c) for c in candidates]
    return candidates, _responded(state.tables, candidates, list(starts))


def _best_values(state: State, share: float = -np.inf) -> dict[str, np.ndarray]:
    """Fitted amplitudes of the best effects and of the base's own parameters, by candidate.

    Args:
        state: The evidence.
        share: Only effects that gain at least this share of what the best one gains.
    """
    scores = one_per_effect(state.scores())[:REFITTED]
    kept = [s for s in scores if s.gain >= share * scores[0].gain or s is scores[0]]
    return {s.candidate.key: s.values for s in kept} | state.base_values()


def _responded(tables: list[Table], candidates: list[Candidate], keys: list[str], *, everywhere: bool = False) -> State:
    """Compute the responses of some candidates anew, at the amplitudes that they now have; see `Table.respond`."""
    wanted = [c for c in candidates if c.key in keys]
    for table in tables:
        table.respond([c.columns[0] for c in wanted if len(c.columns) == 1], everywhere=everywhere)
        for candidate in wanted:
            if len(candidate.columns) > 1:
                table.respond_together(candidate.columns, everywhere=everywhere)
    return State(tables, candidates)


def _moved(candidates: list[Candidate], fitted: Mapping[str, np.ndarray]) -> list[Candidate]:
    """Set the amplitudes of the best candidates to what was fitted, as far as a response can be seen there."""

    def one(candidate: Candidate) -> Candidate:
        if candidate.key not in fitted:
            return candidate
        columns = []
        for column, value in zip(candidate.columns, fitted[candidate.key], strict=True):
            inside = float(np.clip(value, column.low, column.high))
            least = _LEAST_SEEN * abs(column.value)
            # beside others an amplitude may stay as small as it is: it is their sum that is looked at
            small = column.value if len(candidate.columns) == 1 else float(np.copysign(least, inside))
            columns.append(replace(column, value=inside if abs(inside) > least else small))
        return replace(candidate, columns=tuple(columns))

    return [one(candidate) for candidate in candidates]
