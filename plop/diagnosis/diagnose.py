"""From measured episodes and a base to a verdict."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from plop.diagnosis.candidates import BASE_COLUMNS, Candidate, Column, candidates_of
from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.evidence import Evidence, MisfitModel
from plop.diagnosis.finding import Finding
from plop.diagnosis.findings import State
from plop.diagnosis.limits import detection_limits, unseen
from plop.diagnosis.pairs import Pair, find_pair
from plop.diagnosis.profile import STEP, profiles_of
from plop.diagnosis.screen import Score, confounded, one_per_effect
from plop.diagnosis.shams import SHAMS, sham_gains
from plop.diagnosis.starts import begun, one_sided, searched, turned
from plop.diagnosis.table import Measured, RunJobs, Table
from plop.diagnosis.together import least_together
from plop.diagnosis.variants import others_of
from plop.diagnosis.verdict import Verdict, among, first_of, judge, judge_pair
from plop.errors import PlopError
from plop.physics.effects.library import EffectType
from plop.physics.filled import EngineBase
from plop.physics.response import slowdown

LEAST_EPISODES = 4
REFITTED = 4
"""Effects whose response is computed anew at the amplitude found."""
PROFILED_SHARE = 0.5
"""Least share of the best effect's gain from which an effect may be named, so that its amplitude is looked for."""
UNSETTLED = ("NONE OF THESE", "PARTLY")
"""Verdicts after which two laws at once are tried, where there is a reference: they take many more engine runs."""
_LEAST_SEEN = 0.05
"""Least share of the amplitude at which a response was computed from which it is computed anew."""
SLOWER = 16.0
"""How many times more time steps than without it the engine may take for a law whose amplitude is looked for."""


@dataclass(frozen=True)
class Diagnosis:
    """All that was found."""

    verdict: Verdict
    scores: list[Score]
    """Best first, one for each effect; the best were refitted."""
    findings: list[Finding]
    """The same with parameters, p and contrast; the base's own parameters come last."""
    shams: np.ndarray
    """Best gain over the library under each sham."""
    limits: dict[str, dict[str, Any]]
    """Effect -> smallest detectable amplitude and displacement."""
    size: ErrorSize
    """How large the base's error is, here and in the reference."""
    dropped: dict[str, str]
    """Episodes and columns left out, with the reason."""
    evidence: list[Evidence]
    control: list[Evidence]
    misfit: MisfitModel
    settings: list[tuple[Score, dict[str, dict[str, Any]]]]
    """Other settings of the best law that do as well, with their amplitudes."""
    screen_s: float = 0.0
    """Seconds until every law had been tried and ranked, before any was fitted again."""


def diagnose(
    measured: Measured, base: EngineBase, types: Mapping[str, EffectType], run_jobs: RunJobs, *,
    reference: Measured | None = None, effects: Iterable[str] | None = None, sensors: Sequence[str] = (),
    shams: int = SHAMS, seed: int = 0,
) -> Diagnosis:  # fmt: skip
    """Find which effect the base is missing.

    Args:
        measured: Episodes to explain.
        base: The engine, calibrated to the reference; it computes the responses.
        types: The library.
        run_jobs: How engine runs are carried out.
        reference: Episodes that the base was fitted to: they tell how far it is off when nothing is missing.
        effects: Only these effects; all when absent.
        sensors: Significant sensor faults, in words.
        shams: Number of shams.
        seed: Draws the shams.

    Raises:
        PlopError: Too few episodes, the engine cannot follow any or runs with no law, or a law of the user's has a
            mistake.
    """
    check_enough(len(measured.episodes), {})
    started = time.perf_counter()
    wanted = [*types] if effects is None else list(effects)
    candidates = candidates_of(types, wanted)
    tables = [Table(m, base, run_jobs) for m in (measured, reference) if m is not None]
    check_enough(len(tables[0].episodes), tables[0].dropped)
    for table in tables:
        table.respond([column for candidate in candidates for column in candidate.columns])
    _check_laws(tables, candidates)
    candidates, state, begins = _begun_everywhere(State(tables, candidates), candidates)
    screen_s = time.perf_counter() - started
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
    least |= {c.key: least_together(c.columns, best[c.key], state.left_with)
              for c in candidates if c.key in best and c.key not in several and len(c.columns) > 1}  # fmt: skip
    candidates = _moved(candidates, least)
    state = _responded(tables, candidates, list(best), everywhere=True)
    state.profiles = profiles
    found = replace(conclusion(state, sensors, shams, seed), screen_s=screen_s)
    if len(tables) == 2 and _two_are_tried(found.verdict):
        found = _with_pair(found, find_pair(state, candidates, shams=shams, seed=seed))
    return _with_unheard(found, tables, candidates, whole={*types} <= {c.effect for c in candidates})


def _with_unheard(found: Diagnosis, tables: list[Table], candidates: list[Candidate], *, whole: bool) -> Diagnosis:
    """Tell of laws that have no place in the ranking: those that move nothing here, and those that could not be run.

    Args:
        found: What was found with the others.
        tables: They know which runs failed.
        candidates: All that were tried.
        whole: The whole library was to be tried.
    """
    ranked = {score.candidate.effect for score in found.scores}
    unheard = {c.effect: c for c in candidates if c.effect not in ranked and c.effect not in BASE_COLUMNS}
    failed = {name: why for name, why in _failed(tables, candidates).items() if name in unheard}
    tried = [name for name in dict.fromkeys(c.effect for c in candidates) if name not in failed]
    silent = "it moves nothing that was followed in these recordings"
    return replace(
        found, verdict=found.verdict if whole and not failed else among(found.verdict, tried),
        dropped=found.dropped | {name: failed.get(name, silent) for name in unheard},
        limits=found.limits | {name: unseen(c.columns[0]) for name, c in unheard.items()})  # fmt: skip


def _failed(tables: list[Table], candidates: list[Candidate]) -> dict[str, str]:
    """Give the laws of which no setting could be run, and why."""
    troubles = {key: why for table in tables for key, why in table.dropped.items()}
    run = {c.effect for c in candidates if not any(column.key in troubles for column in c.columns)}
    return {c.effect: troubles[column.key] for c in candidates for column in c.columns
            if c.effect not in run and column.key in troubles}  # fmt: skip


def _check_laws(tables: list[Table], candidates: list[Candidate]) -> None:
    """Refuse to judge where no law can be run.

    Raises:
        PlopError: The engine runs with none of them.
    """
    laws, failed = {c.effect for c in candidates if c.kind != "base"}, _failed(tables, candidates)
    if laws and laws <= failed.keys():
        raise PlopError("No law could be judged: the engine runs with none of them.", found="; ".join(failed.values()),
                        fix="Mend the law, or give it a smaller `typical` amplitude.")  # fmt: skip


def _two_are_tried(verdict: Verdict) -> bool:
    """Tell whether two laws shall be fitted together: none settles it, or two do, each of which was fitted alone."""
    two = verdict.kind == "EFFECT" and len(verdict.named) > 1
    return two or verdict.kind in UNSETTLED


def _with_pair(found: Diagnosis, pair: Pair | None) -> Diagnosis:
    """Let two laws that were fitted together stand in place of a verdict that leaves much open."""
    if pair is None:
        return found
    verdict = judge_pair(found.verdict, pair.first, pair.second, pair.left, pair.size)
    if verdict is found.verdict:
        return found
    others = [f for f in found.findings if f.name not in verdict.named]
    return replace(found, verdict=verdict, findings=[pair.first, pair.second, *others], size=pair.size)


def _affordable(column: Column, base: EngineBase, types: Mapping[str, EffectType]) -> Column:
    """Limit how far a profile goes: runs with much viscosity, for one, take ever more time steps."""
    value = column.value
    while abs(value) < max(abs(column.low), abs(column.high)):
        value *= STEP
        if slowdown(column.build(types, value), base.material, base.config) > SLOWER:
            ends = sorted((value / STEP, -value / STEP))
            return replace(column, low=max(column.low, ends[0]), high=min(column.high, ends[1]))
    return column


def _begun_everywhere(state: State, candidates: list[Candidate]) -> tuple[list[Candidate], State, dict[str, Candidate]]:
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


def check_enough(count: int, dropped: Mapping[str, str]) -> None:
    """Refuse to judge by a few episodes.

    Args:
        count: How many there are.
        dropped: Those left out, with the reason.

    Raises:
        PlopError: They are too few.
    """
    if count < LEAST_EPISODES:
        why = "".join(f"; {name} is left out: {reason}" for name, reason in dropped.items())
        raise PlopError("There are too few episodes for a verdict.", expected=f"at least {LEAST_EPISODES}",
                        found=f"{count}{why}"[:400],
                        fix="Record more motions; a verdict from fewer would be a guess.")  # fmt: skip


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


def conclusion(state: State, sensors: Sequence[str], shams: int, seed: int) -> Diagnosis:
    """Judge by what has been computed; see `diagnose` for the arguments."""
    scores = state.judged()
    sham = sham_gains(state.screen, seed=seed, count=shams, alone=not state.control)
    findings = [state.finding(score, sham) for score in scores]
    base = state.base_finding(sham)
    first = scores[first_of(findings) or 0] if scores else None
    left = None if first is None else state.left(first)
    alike = [] if first is None else [s.candidate.effect for s in confounded(state.screen, first, scores)]
    second = None if first is None else state.beyond(first, sham)
    verdict = judge(findings, alike, base, list(sensors), state.size, left=left, second=second)
    contrasts = {f.name: f.contrast for f in findings if f.contrast is not None}
    limits = detection_limits(state.screen, scores, sham, state.response_rms_m, contrasts, state.would_stand_out)
    where = ("", "reference ")  # both sets may have an episode of the same name
    dropped = {f"{where[k]}{key}": why for k, table in enumerate(state.tables) for key, why in table.dropped.items()}
    settings = [] if first is None else [(score, state.amplitudes(score)) for score in state.settings(first)]
    return Diagnosis(verdict, scores, [*findings, base], sham, limits, state.size, dropped,
                     state.evidence, state.control, state.misfit, settings)  # fmt: skip
