"""Two laws at once, where none explains the error by itself: the second is looked for beside the first, in rollout.

Alone, each of two laws may explain little: what the other does hides it, and a response without the other is another
one. An object that a sticky tool lifts is not pressed on the table, and slides differently under a tilt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plop.diagnosis.candidates import BASE_COLUMNS, Candidate
from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.evidence import corrected, whiten
from plop.diagnosis.finding import Finding
from plop.diagnosis.findings import finding_of
from plop.diagnosis.judge import PAIR_SHARE
from plop.diagnosis.responses import Settings
from plop.diagnosis.screen import Score, Screen, one_per_effect
from plop.diagnosis.shams import sham_gains
from plop.diagnosis.state import State
from plop.diagnosis.together import directions, least_together

SECONDS = 2
"""Laws whose amplitudes are looked for in rollout because of what they do beside the first one."""


@dataclass(frozen=True)
class Pair:
    """Two laws that were fitted together; the gain of each is a share of what the other leaves."""

    first: Finding
    second: Finding
    left: float
    """Mean squared whitened held-out residual with both."""
    size: ErrorSize
    """How large the base's error is; judged anew, since what the reference shows of both laws is taken off."""


def find_pair(state: State, candidates: Sequence[Candidate], *, shams: int, seed: int) -> Pair | None:
    """Look for a law beside the best one and fit both.

    Args:
        state: The evidence, with the responses at the amplitudes found.
        candidates: All hypotheses, with these amplitudes.
        shams: Number of shams.
        seed: Draws them.

    Returns:
        None where there are not two laws to be tried, or the engine is unstable with both.
    """
    alone = [score for score in state.judged() if score.candidate.kind == "physics"]
    if not alone:
        return None
    first = alone[0].candidate
    # what the first law hides where it was fitted without the second may still be next to it by itself
    both = _best_pair(state, first, one_per_effect([*alone[1:2], *_beside(state, first, candidates)[:SECONDS]]))
    if both is None:
        return None
    for table in state.tables:
        table.respond_together([*both[0].columns, *both[1].columns], everywhere=True)
    moved = {candidate.key: candidate for candidate in both}
    return _judged(State(state.tables, [moved.get(c.key, c) for c in candidates]), both, shams, seed)


def _best_pair(state: State, first: Candidate, seconds: list[Score]) -> tuple[Candidate, Candidate] | None:
    """Fit the first law with each of the others until two of them do, and give the pair that leaves least."""
    found: tuple[Candidate, Candidate] | None = None
    least = np.inf
    for score in seconds:
        left, values = _fitted(state, first, score)
        if left is None or left >= least:
            continue
        least, count = left, len(first.columns)
        found = _with_values(first, values[:count]), _with_values(score.candidate, values[count:])
        if (state.size.closed(left / state.numbers) or 0.0) >= PAIR_SHARE:
            break
    return found


def _settings(candidate: Candidate) -> Settings:
    return tuple((column, column.value) for column in candidate.columns)


def _with_values(candidate: Candidate, values: np.ndarray) -> Candidate:
    columns = zip(candidate.columns, values.tolist(), strict=True)
    return replace(candidate, columns=tuple(replace(column, value=value or column.value) for column, value in columns))


def _beside(state: State, first: Candidate, candidates: Sequence[Candidate]) -> list[Score]:
    """Score all laws by what they do while the first one acts, best first, one for each effect."""
    others = [c for c in candidates if c.kind == "physics" and c.effect != first.effect]
    columns = [column for candidate in others for column in candidate.columns]
    wanted = [_settings(first), *((*_settings(first), (column, column.value)) for column in columns)]
    with_first, *with_both = state.tables[0].changes(wanted)
    if with_first is None:
        return []
    stable = {
        column.key: (column, change) for column, change in zip(columns, with_both, strict=True) if change is not None
    }
    base = [c for c in candidates if c.effect in BASE_COLUMNS]
    kept = [column.key for candidate in (first, *base) for column in candidate.columns if column.key in state.keys]
    rows = []
    for k, own in enumerate(state.tables[0].responses):
        rows.append(
            {key: own[key] for key in kept}
            | {key: (change[k] - with_first[k]) / column.value for key, (column, change) in stable.items()}
        )
    keys = [*kept, *stable]
    episodes = [
        whiten(replace(e, residual=corrected(known, state.keys, state.known).residual), state.misfit, keys)
        for e, known in zip(state.tables[0].evidence(rows), state.evidence, strict=True)
    ]
    usable = [c for c in (first, *base, *others) if all(column.key in keys for column in c.columns)]
    screen = Screen(episodes, keys, usable)
    return one_per_effect(_of_physics(screen, first))


def _of_physics(screen: Screen, first: Candidate) -> list[Score]:
    return [score for score in screen.scores(lambda key: 0.0, given=first) if score.candidate.kind == "physics"]


def _fitted(state: State, first: Candidate, second: Score) -> tuple[float | None, np.ndarray]:
    """Fit both laws in rollout: sum of squares that is left (None: unstable), and their amplitudes."""
    columns = [*first.columns, *second.candidate.columns]
    start = np.concatenate([[column.value for column in first.columns], second.values])
    values = least_together(columns, start, state.left_with, _turned(first, second.candidate, start))
    (left,) = state.left_with([tuple(zip(columns, values.tolist(), strict=True))])
    return None if left is None else float(left @ left), values


def _turned(first: Candidate, second: Candidate, start: np.ndarray) -> list[np.ndarray]:
    """Give other first guesses [C]: a law of several amplitudes as large, in other directions than it has alone."""
    turned = []
    for law, at in ((first, 0), (second, len(first.columns))):
        own = slice(at, at + len(law.columns))
        for direction in directions(len(law.columns)) if len(law.columns) > 1 else []:
            turned.append(start.copy())
            turned[-1][own] = direction * np.linalg.norm(start[own]) / np.linalg.norm(direction)
    return turned


def _judged(state: State, both: tuple[Candidate, Candidate], shams: int, seed: int) -> Pair | None:
    found = []
    for given, wanted in (both[::-1], both):
        scores = state.screen.scores(state.response_rms_m, given=given)
        found.append(next((score for score in scores if score.candidate.key == wanted.key), None))
    beyond_second, beyond_first = found
    if beyond_second is None or beyond_first is None:
        return None
    gains = sham_gains(state.screen, seed=seed, count=shams)
    first, second = (finding_of(state, score, gains, beside=True) for score in (beyond_second, beyond_first))
    return Pair(first, second, state.left(beyond_first), state.size)
