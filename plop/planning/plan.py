"""From a base and its reference recordings to a protocol: responses, power, separation, motions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from plop.diagnosis.evidence import evidence_of
from plop.diagnosis.hypotheses import Hypothesis, Settings, candidates_of, hypotheses_of
from plop.diagnosis.responses import Job
from plop.diagnosis.result import Diagnosis
from plop.diagnosis.rule import RULE, DecisionRule
from plop.diagnosis.search import base_hypotheses
from plop.diagnosis.table import Measured, RunJobs, Table
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import EffectType
from plop.planning.design import Design
from plop.planning.motions import Change, Motion, as_expected, planned_episode
from plop.planning.power import LawPower, powers
from plop.planning.questions import SILENT, answerable, found_by, pairs_of, typical_ones
from plop.planning.result import MotionChoice, Separation
from plop.planning.separation import Pair, least_information, settled_chance
from plop.tracking.episode import Episode

TWICE = 2
"""Recordings of a motion by which motions are compared: an episode is predicted from the others of its kind."""
REPEATS = (2, 3, 4, 6)
"""Recordings of one motion, in each set, that are tried."""
BEST = 5
"""Motions that are tried with more recordings."""


@dataclass(frozen=True)
class Planned:
    """What was found; the protocol follows from it."""

    laws: list[LawPower]
    ways: list[int]
    separation: Separation | None
    best: Motion | None
    """The motion that distinguishes."""
    motions: list[Motion]
    """As recorded."""
    choices: list[Motion]
    """The family."""
    dropped: dict[str, str]


def plan(
    measured: Measured,
    base: EngineBase,
    types: Mapping[str, EffectType],
    run_jobs: RunJobs,
    *,
    effects: Iterable[str] | None = None,
    between: Sequence[str] = (),
    diagnosis: Diagnosis | None = None,
    vary: Sequence[Change] = tuple(Change),
    most: int = 4,
    again: bool = True,
    seed: int = 0,
    announce: Callable[[str], None] = lambda step: None,
    rule: DecisionRule = RULE,
) -> Planned:
    """Find what would be seen, and the motion that distinguishes.

    Args:
        measured: The reference: episodes in which nothing is missing.
        base: The engine; it computes the responses.
        types: The library.
        run_jobs: How engine runs are carried out.
        effects: Only these laws; all when absent.
        between: Laws that are to be distinguished.
        diagnosis: A diagnosis whose verdict leaves laws, or settings of one, undistinguished; instead of `between`.
        vary: How motions may be changed.
        most: Repeats of all motions that are tried at most.
        again: The motion that distinguishes is recorded in the reference, too.
        seed: Of the draws.
        announce: Called with what the engine runs that follow are for, in a few words.
        rule: Error rates and margins.

    Raises:
        PlopError: The engine follows no episode, a law to distinguish moves nothing, or a diagnosis leaves nothing to
            distinguish.
    """
    wanted = [*types] if effects is None else [*dict.fromkeys((*effects, *between))]
    candidates = candidates_of(types, wanted)
    announce("no law")
    table = Table(measured, base, run_jobs)
    announce("every law")
    asked = None if diagnosis is None else found_by(diagnosis, candidates_of(types))
    tried = hypotheses_of(candidates) if asked is None else asked.hypotheses
    own = base_hypotheses(candidates_of(types))
    table.respond(_settings([*tried, *own]))
    dropped, usable = {**table.dropped}, [h for h in tried if table.trouble(h) is None and _moves(table, h)]
    dropped |= _unusable(table, tried, usable)
    if between:
        asked = typical_ones(between, tried)
    if asked is not None:
        asked = answerable(asked, usable, dropped)
    own = [h for h in own if table.trouble(h) is None]
    motions = [_recorded(table, k, usable, own) for k in range(len(table.episodes))]
    # where the recordings have been made, their diagnosis says what they show
    laws, ways = powers(motions, usable, most, seed=seed, rule=rule) if diagnosis is None else ([], [])
    if asked is None:
        return Planned(laws, ways, None, None, motions, motions, dropped)
    here = motions if diagnosis is None else _as_diagnosed(motions, diagnosis)
    pairs = pairs_of(asked, usable, Design(here, motions, seed))
    announce("motions that may distinguish")
    few = sorted({k for pair in pairs for k in (pair.truth, pair.rival)})
    pairs = [Pair(few.index(p.truth), p.amount, few.index(p.rival)) for p in pairs]
    motions, here = (
        [replace(m, responses=tuple(m.responses[k] for k in few)) for m in some] for some in (motions, here)
    )
    choices = [*motions, *_varied(table, motions, [usable[k] for k in few], own, vary, dropped)]

    def design(motion: Motion, count: int) -> Design:
        more = [motion] * count
        return Design([*here, *more], [*motions, *(more if again else [])], seed)

    found, best = _separated(asked.labels, pairs, choices, design, rule)
    return Planned(laws, ways, found, best, motions, choices, dropped)


def _settings(hypotheses: Iterable[Hypothesis]) -> list[Settings]:
    return [settings for hypothesis in hypotheses for settings, _ in hypothesis.runs]


def _moves(table: Table, hypothesis: Hypothesis) -> bool:
    return any(np.any(changes) for changes in table.response(hypothesis))


def _unusable(table: Table, tried: Sequence[Hypothesis], usable: Sequence[Hypothesis]) -> dict[str, str]:
    """Say of the laws of which nothing can be said why."""
    known, why = {h.effect for h in usable}, dict[str, str]()
    for hypothesis in tried:
        if hypothesis.effect not in known:
            why.setdefault(hypothesis.effect, table.trouble(hypothesis) or SILENT)
    return why


def _recorded(table: Table, k: int, hypotheses: Sequence[Hypothesis], own: Sequence[Hypothesis]) -> Motion:
    """Describe a motion that was recorded."""
    episode, evidence = table.episodes[k], table.evidence[k]
    columns = [table.response(h)[k] for h in own]
    stacked = np.stack(columns, -1) if columns else np.zeros((*evidence.residual.shape, 0))
    responses = tuple(table.response(h)[k] for h in hypotheses)
    return Motion(episode.name, episode.name, Change.NONE, episode.tool, table.kinds[k], evidence, stacked, responses)


def _as_diagnosed(motions: Sequence[Motion], diagnosis: Diagnosis) -> list[Motion]:
    """Give the motions of the recordings that were diagnosed: those of the same name, else as many in turn."""
    named = {motion.name: motion for motion in motions}
    if set(diagnosis.episodes) <= named.keys():
        return [named[name] for name in diagnosis.episodes]
    return [motions[k % len(motions)] for k in range(len(diagnosis.episodes))]


def _varied(
    table: Table,
    motions: Sequence[Motion],
    hypotheses: Sequence[Hypothesis],
    own: Sequence[Hypothesis],
    vary: Sequence[Change],
    dropped: dict[str, str],
) -> list[Motion]:
    """Run the motions of the family: of each kind of recorded motion, the first, with its path changed in every way."""
    sources: dict[str, int] = {}
    for k, motion in enumerate(motions):
        sources.setdefault(motion.kind, k)
    planned = [
        (k, change, episode)
        for k in sources.values()
        for change in vary
        if change != Change.NONE and (episode := planned_episode(table.episodes[k], change)) is not None
    ]
    settings = [(), *dict.fromkeys(_settings([*hypotheses, *own]))]
    table.run_jobs([Job(episode, table.base, each) for _, _, episode in planned for each in settings])
    found = []
    for k, change, episode in planned:
        try:
            found.append(_run(table, k, change, episode, hypotheses, own))
        except PlopError as error:
            dropped[episode.name] = f"{error.problem} {error.found or ''}".strip()
    return found


def _run(
    table: Table, k: int, change: Change, episode: Episode, hypotheses: Sequence[Hypothesis], own: Sequence[Hypothesis]
) -> Motion:
    """Describe a planned motion.

    Raises:
        PlopError: The engine cannot follow it, with every law.
    """
    single = Table(Measured([episode], {episode.name: [episode.points]}), table.base, table.run_jobs)
    single.respond(_settings([*hypotheses, *own]))
    if single.failed:
        raise PlopError("The engine cannot follow it.", found="; ".join(single.failed.values())[:200])
    made = _recorded(single, 0, hypotheses, own)
    evidence = as_expected(evidence_of(episode, single.plain[0][:1]), table.evidence[k])
    return replace(made, like=table.episodes[k].name, change=change, evidence=evidence)


def _separated(
    labels: tuple[str, ...],
    pairs: Sequence[Pair],
    choices: Sequence[Motion],
    design: Callable[[Motion, int], Design],
    rule: DecisionRule,
) -> tuple[Separation, Motion]:
    """Rank the motions by information, and find which of the best has to be recorded least often."""
    scored = [(least_information(design(motion, TWICE), pairs, rule), motion) for motion in choices]
    ranked = sorted(scored, key=lambda entry: (-entry[0], entry[1].name))
    trials = []
    for count in REPEATS:
        trials += [(settled_chance(design(m, count), pairs, rule), -count, value, m) for value, m in ranked[:BEST]]
        if max(trials, key=lambda trial: trial[:3])[0] >= rule.seen:
            break
    chance, count, _, best = max(trials, key=lambda trial: (min(trial[0], rule.seen), *trial[1:3]))
    plain = design(choices[0], 0)
    rows = tuple(MotionChoice(m.name, m.like, m.change, value) for value, m in ranked)
    left, alone = least_information(plain, pairs, rule), settled_chance(plain, pairs, rule)
    return Separation(labels, rows, best.name, left, alone, -count, chance), best
