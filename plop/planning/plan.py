"""From a base and its reference recordings to a protocol: responses, power, separation, motions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from plop.diagnosis.diagnose import survey_of
from plop.diagnosis.evidence import evidence_of
from plop.diagnosis.hypotheses import Hypothesis, Settings, base_hypotheses, candidates_of, hypotheses_of
from plop.diagnosis.repeats import tables_of
from plop.diagnosis.response_table import RunJobs
from plop.diagnosis.responses import Job
from plop.diagnosis.result import Diagnosis
from plop.diagnosis.rule import RULE, DecisionRule
from plop.diagnosis.table import Measured, Table
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import EffectType
from plop.planning.design import Design
from plop.planning.motions import Change, Motion, as_expected, planned_episode
from plop.planning.power import LawPower, powers
from plop.planning.questions import SILENT, Question, answerable, found_by, pairs_of, typical_ones, with_all_laws
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


@dataclass(frozen=True)
class Wish:
    """What is wanted of a plan."""

    between: Sequence[str] = ()
    """Laws that are to be distinguished."""
    diagnosis: Diagnosis | None = None
    """Instead: a diagnosis whose verdict leaves laws, or settings of one, undistinguished."""
    vary: Sequence[Change] = tuple(Change)
    """How motions may be changed."""
    most: int = 4
    """Recordings of every motion, in each set, that are tried at most."""
    again: bool = True
    """The motion that distinguishes is recorded in the reference, too."""
    seed: int = 0
    """Of the draws."""


def plan(
    measured: Measured,
    base: EngineBase,
    types: Mapping[str, EffectType],
    run_jobs: RunJobs,
    wish: Wish,
    *,
    effects: Iterable[str] | None = None,
    announce: Callable[[str], None] = lambda step: None,
    rule: DecisionRule = RULE,
) -> Planned:
    """Find what would be seen, and the motion that distinguishes.

    Args:
        measured: The reference: episodes in which nothing is missing.
        base: The engine; it computes the responses.
        types: The library.
        run_jobs: How engine runs are carried out.
        wish: What is wanted.
        effects: Only these laws; all when absent.
        announce: Called with what the engine runs that follow are for, in a few words.
        rule: Error rates and margins.

    Raises:
        PlopError: The engine follows no episode, a law to distinguish moves nothing, or a diagnosis leaves nothing to
            distinguish.
    """
    known, own = wish.diagnosis is not None, surveyed(base_hypotheses(candidates_of(types)))
    tried = surveyed(hypotheses_of(candidates_of(types, None if effects is None else [*effects, *wish.between])))
    asked = typical_ones(wish.between, tried)
    if wish.diagnosis is not None:
        asked = found_by(wish.diagnosis, candidates_of(types))
        asked = replace(asked, groups=tuple(tuple(surveyed(group)) for group in asked.groups))
        tried = [*tried, *asked.hypotheses]
    announce("no law")
    (table,) = tables_of([measured], base, run_jobs, survey_of(base, measured.episodes))
    announce("every law")
    table.respond([*tried, *own])
    usable, own = ([h for h in some if table.trouble(h) is None and _moves(table, h)] for some in (tried, own))
    dropped = {**table.dropped, **_unusable(table, tried, usable)}
    asked = answerable(asked, usable, dropped)
    motions = [_recorded(table, k, usable, own) for k in range(len(table.episodes))]
    # where the recordings have been made, their diagnosis says what they show
    laws, ways = ([], []) if known else powers(motions, usable, wish.most, seed=wish.seed, rule=rule)
    found = Planned(laws, ways, None, None, motions, motions, dropped)
    if not asked.groups:
        return found
    announce("motions that may distinguish")
    return _with_separation(found, table, asked, usable, own, wish, rule)


def _with_separation(
    found: Planned,
    table: Table,
    asked: Question,
    usable: Sequence[Hypothesis],
    own: Sequence[Hypothesis],
    wish: Wish,
    rule: DecisionRule,
) -> Planned:
    """Rank motions by the pairs that are most alike; see with all laws how often the best have to be recorded."""
    motions = found.motions
    here = range(len(motions)) if wish.diagnosis is None else _diagnosed(motions, wish.diagnosis)

    def design(pairs: Sequence[Pair], motion: Motion | None, count: int, hidden: int | None = None) -> Design:
        few = _columns(pairs)
        own = [replace(m, responses=tuple(m.responses[k] for k in few)) for m in motions]
        more = [] if motion is None else [own[motions.index(motion)] if motion in motions else motion] * count
        return Design([*(own[k] for k in here), *more], [*own, *(more if wish.again else [])], wish.seed, hidden)

    def settled(motion: Motion | None, count: int) -> float:
        return settled_chance(partial(design, pairs, motion, count), _numbered(pairs), rule)

    recorded = Design([motions[k] for k in here], motions, wish.seed)
    asked_for = pairs_of(asked, usable, recorded)
    few = [usable[k] for k in _columns(asked_for)]
    choices = [*motions, *_varied(table, motions, few, own, wish.vary, found.dropped)]
    numbered = _numbered(asked_for)
    scored = [(least_information(design(asked_for, motion, TWICE), numbered, rule), motion) for motion in choices]
    ranked = sorted(scored, key=lambda entry: (-entry[0], entry[1].name))
    pairs = with_all_laws(asked_for, asked, usable, recorded)
    few = [usable[k] for k in _columns(pairs)]
    best = [(value, _with_more(table, motions, motion, few, own)) for value, motion in ranked[:BEST]]
    trials = []
    for count in REPEATS:
        trials += [(settled(motion, count), -count, value, motion) for value, motion in best]
        if max(trial[0] for trial in trials) >= rule.seen:
            break
    chance, count, _, chosen = max(trials, key=lambda trial: (min(trial[0], rule.seen), *trial[1:3]))
    separation = Separation(
        asked.labels,
        tuple(MotionChoice(m.name, m.like, m.change, value) for value, m in ranked),
        chosen.name,
        least_information(recorded, asked_for, rule),
        settled(None, 0),
        -count,
        chance,
    )
    return replace(found, separation=separation, best=chosen, choices=choices)


def _numbered(pairs: Sequence[Pair]) -> list[Pair]:
    """Number the hypotheses of pairs among themselves."""
    few = _columns(pairs)
    return [Pair(few.index(pair.truth), few.index(pair.rival)) for pair in pairs]


def _columns(pairs: Sequence[Pair]) -> list[int]:
    """List the hypotheses of pairs."""
    return sorted({k for pair in pairs for k in (pair.truth, pair.rival)})


def _with_more(
    table: Table, motions: Sequence[Motion], motion: Motion, hypotheses: Sequence[Hypothesis], own: Sequence[Hypothesis]
) -> Motion:
    """Run more laws in a motion that is not one of those that were recorded."""
    if motion in motions:
        return motion
    k = next(k for k, each in enumerate(motions) if each.name == motion.like)
    episode = planned_episode(table.episodes[k], motion.change)
    assert episode is not None
    return _run(table, k, motion.change, _alone(table, episode), hypotheses, own)


def surveyed(hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
    """Have all responses computed with few particles: they are compared with each other."""
    return [replace(hypothesis, coarse=True) for hypothesis in hypotheses]


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


def _diagnosed(motions: Sequence[Motion], diagnosis: Diagnosis) -> list[int]:
    """Give the motions of the recordings that were diagnosed: those of the same name, else as many in turn."""
    named = {motion.name: k for k, motion in enumerate(motions)}
    if set(diagnosis.episodes) <= named.keys():
        return [named[name] for name in diagnosis.episodes]
    return [k % len(motions) for k in range(len(diagnosis.episodes))]


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
    engines = dict.fromkeys([table.base, table.survey.base])
    table.run_jobs([Job(episode, engine) for _, _, episode in planned for engine in engines])  # at the same time
    alone, found = [], []
    for k, change, episode in planned:
        with _dropping(episode, dropped):
            alone.append((k, change, _alone(table, episode)))
    settings = dict.fromkeys(_settings([*hypotheses, *own]))
    table.run_jobs([job for _, _, each in alone for law in settings for job in each.survey.jobs(law).values()])
    for k, change, each in alone:
        with _dropping(each.episodes[0], dropped):
            found.append(_run(table, k, change, each, hypotheses, own))
    return found


@contextmanager
def _dropping(episode: Episode, dropped: dict[str, str]) -> Iterator[None]:
    """Leave an episode out that the engine cannot follow."""
    try:
        yield
    except PlopError as error:
        dropped[episode.name] = f"{error.problem} {error.found or ''}".strip()


def _alone(table: Table, episode: Episode) -> Table:
    """Run the engine without laws through a planned motion.

    Raises:
        PlopError: It cannot follow it.
    """
    survey = None if table.survey is table.full else table.survey.base
    return Table(Measured([episode], {episode.name: [episode.points]}), table.base, table.run_jobs, survey)


def _run(
    table: Table, k: int, change: Change, alone: Table, hypotheses: Sequence[Hypothesis], own: Sequence[Hypothesis]
) -> Motion:
    """Describe a planned motion.

    Raises:
        PlopError: The engine cannot follow it, with every law.
    """
    alone.respond([*hypotheses, *own])
    if alone.failed:
        raise PlopError("The engine cannot follow it.", found="; ".join(alone.failed.values())[:200])
    episode = alone.episodes[0]
    made = _recorded(alone, 0, hypotheses, own)
    evidence = as_expected(evidence_of(episode, alone.plain[0][:1]), table.evidence[k])
    return replace(made, like=table.episodes[k].name, change=change, evidence=evidence)
