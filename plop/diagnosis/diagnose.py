"""From measured episodes and a base to a verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from plop.diagnosis.amplitudes import begun_everywhere, of_least_error
from plop.diagnosis.candidates import BASE_COLUMNS, Candidate, candidates_of
from plop.diagnosis.conclusion import Conclusion, conclusion
from plop.diagnosis.judge import judge_pair
from plop.diagnosis.limits import unseen
from plop.diagnosis.pairs import Pair, find_pair
from plop.diagnosis.shams import SHAMS
from plop.diagnosis.state import State
from plop.diagnosis.table import Measured, RunJobs, Table
from plop.diagnosis.unnamed import among
from plop.diagnosis.verdict import Verdict, VerdictKind
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import EffectType

LEAST_EPISODES = 4
UNSETTLED = (VerdictKind.NONE_OF_THESE, VerdictKind.PARTLY)
"""Verdicts after which two laws at once are tried, where there is a reference: they take many more engine runs."""


def diagnose(
    measured: Measured,
    base: EngineBase,
    types: Mapping[str, EffectType],
    run_jobs: RunJobs,
    *,
    reference: Measured | None = None,
    effects: Iterable[str] | None = None,
    sensors: Sequence[str] = (),
    shams: int = SHAMS,
    seed: int = 0,
    told: Callable[[str], None] = lambda step: None,
) -> Conclusion:
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
        told: Called with what the engine runs that follow are for, in a few words.

    Raises:
        PlopError: Too few episodes, the engine cannot follow any or runs with no law, or a law of the user's has a
            mistake.
    """
    check_enough(len(measured.episodes), {})
    started = time.perf_counter()
    wanted = [*types] if effects is None else list(effects)
    candidates = candidates_of(types, wanted)
    told("no law")
    tables = [Table(m, base, run_jobs) for m in (measured, reference) if m is not None]
    check_enough(len(tables[0].episodes), tables[0].dropped)
    for table, name in zip(tables, ("recordings", "reference"), strict=False):
        told(f"every law, {name}")
        table.respond([column for candidate in candidates for column in candidate.columns])
    _check_laws(tables, candidates)
    told("where laws begin")
    candidates, state, begins = begun_everywhere(State(tables, candidates), candidates)
    screen_s = time.perf_counter() - started
    told("amplitudes of the best")
    candidates, state = of_least_error(state, candidates, begins, base, types)
    found = replace(conclusion(state, sensors, shams, seed), screen_s=screen_s)
    if len(tables) == 2 and _two_are_tried(found.verdict):
        told("two laws at once")
        found = _with_pair(found, find_pair(state, candidates, shams=shams, seed=seed))
    return _with_unheard(found, tables, candidates, whole={*types} <= {c.effect for c in candidates})


def _with_unheard(found: Conclusion, tables: list[Table], candidates: list[Candidate], *, whole: bool) -> Conclusion:
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
        found,
        verdict=found.verdict if whole and not failed else among(found.verdict, tried, found.size),
        dropped=found.dropped | {name: failed.get(name, silent) for name in unheard},
        limits=found.limits | {name: unseen(c.columns[0]) for name, c in unheard.items()},
    )


def _failed(tables: list[Table], candidates: list[Candidate]) -> dict[str, str]:
    """Give the laws of which no setting could be run, and why."""
    troubles = {key: why for table in tables for key, why in table.dropped.items()}
    run = {c.effect for c in candidates if not any(column.key in troubles for column in c.columns)}
    return {
        c.effect: troubles[column.key]
        for c in candidates
        for column in c.columns
        if c.effect not in run and column.key in troubles
    }


def _check_laws(tables: list[Table], candidates: list[Candidate]) -> None:
    """Refuse to judge where no law can be run.

    Raises:
        PlopError: The engine runs with none of them.
    """
    laws, failed = {c.effect for c in candidates if c.kind != "base"}, _failed(tables, candidates)
    if laws and laws <= failed.keys():
        raise PlopError(
            "No law could be judged: the engine runs with none of them.",
            found="; ".join(failed.values()),
            fix="Mend the law, or give it a smaller `typical` amplitude.",
        )


def _two_are_tried(verdict: Verdict) -> bool:
    """Tell whether two laws shall be fitted together: none settles it, or two do, each of which was fitted alone."""
    two = verdict.kind == VerdictKind.EFFECT and len(verdict.named) > 1
    return two or verdict.kind in UNSETTLED


def _with_pair(found: Conclusion, pair: Pair | None) -> Conclusion:
    """Let two laws that were fitted together stand in place of a verdict that leaves much open."""
    if pair is None:
        return found
    verdict = judge_pair(found.verdict, pair.first, pair.second, pair.left, pair.size)
    if verdict is found.verdict:
        return found
    others = [f for f in found.findings if f.name not in verdict.named]
    return replace(found, verdict=verdict, findings=[pair.first, pair.second, *others], size=pair.size)


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
        raise PlopError(
            "There are too few episodes for a verdict.",
            expected=f"at least {LEAST_EPISODES}",
            found=f"{count}{why}"[:400],
            fix="Record more motions; a verdict from fewer would be a guess.",
        )
