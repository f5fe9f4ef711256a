"""From a base and its reference recordings to a protocol: responses, power, separation, motions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from plop.diagnosis.decision.result import Diagnosis
from plop.diagnosis.diagnose import survey_of
from plop.diagnosis.responses.hypotheses import Hypothesis, base_hypotheses, candidates_of, hypotheses_of
from plop.diagnosis.responses.repeats import tables_of
from plop.diagnosis.responses.response_table import RunJobs
from plop.diagnosis.responses.table import Measured, Table
from plop.diagnosis.rule import RULE, DecisionRule
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import EffectType
from plop.planning.design import Design
from plop.planning.engine_runs import recorded_motion, varied_motions, with_more
from plop.planning.motions import Change, Motion, elsewhere
from plop.planning.power import LawPower, powers
from plop.planning.questions import SILENT, Question, answerable, found_by, pairs_of, typical_ones, with_all_laws
from plop.planning.result import MotionChoice, Separation
from plop.planning.separation import Pair, least_information, settled_chance

TWICE = 2
"""Recordings of a motion by which motions are compared: an episode is predicted from the others of its kind."""
REPEATS = (1, 2, 3, 4, 6)
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
    motions = [recorded_motion(table, k, usable, own) for k in range(len(table.episodes))]
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
    here = motions if wish.diagnosis is None else _diagnosed(motions, wish.diagnosis)

    def design(pairs: Sequence[Pair], motion: Motion | None, count: int, hidden: int | None = None) -> Design:
        few = _columns(pairs)
        own, explained = ([_with_only(few, m) for m in some] for some in (motions, here))
        more = [] if motion is None else [own[motions.index(motion)] if motion in motions else motion] * count
        return Design([*explained, *more], [*own, *(more if wish.again else [])], wish.seed, hidden)

    def settled(motion: Motion | None, count: int) -> float:
        return settled_chance(partial(design, pairs, motion, count), _numbered(pairs), gains, rule)

    recorded = Design(here, motions, wish.seed)
    asked_for = pairs_of(asked, usable, recorded)
    few = [usable[k] for k in _columns(asked_for)]
    choices = [*motions, *varied_motions(table, motions, few, own, wish.vary, found.dropped)]
    numbered = _numbered(asked_for)
    scored = [(least_information(design(asked_for, motion, TWICE), numbered, rule), motion) for motion in choices]
    ranked = sorted(scored, key=lambda entry: (-entry[0], entry[1].name))
    pairs = with_all_laws(asked_for, asked, usable, recorded)
    few = [usable[k] for k in _columns(pairs)]
    gains = _found(wish.diagnosis, asked, few)
    best = [(value, with_more(table, motions, motion, few, own)) for value, motion in ranked[:BEST]]
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


def _with_only(hypotheses: Sequence[int], motion: Motion) -> Motion:
    """Keep the responses of some hypotheses."""
    return replace(motion, responses=tuple(motion.responses[k] for k in hypotheses))


def _found(diagnosis: Diagnosis | None, asked: Question, hypotheses: Sequence[Hypothesis]) -> dict[int, np.ndarray]:
    """Give the gains of recordings that a diagnosis found for the laws of hypotheses, by number.

    None of one law's settings, of which only the best was kept.
    """
    if diagnosis is None or len({hypothesis.effect for hypothesis in asked.hypotheses}) == 1:
        return {}
    rows = {k: diagnosis.row(hypothesis.effect) for k, hypothesis in enumerate(hypotheses)}
    return {k: np.array(row.gains[: len(diagnosis.episodes)]) for k, row in rows.items() if row is not None}


def _numbered(pairs: Sequence[Pair]) -> list[Pair]:
    """Number the hypotheses of pairs among themselves."""
    few = _columns(pairs)
    return [Pair(few.index(pair.truth), few.index(pair.rival)) for pair in pairs]


def _columns(pairs: Sequence[Pair]) -> list[int]:
    """List the hypotheses of pairs."""
    return sorted({k for pair in pairs for k in (pair.truth, pair.rival)})


def surveyed(hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
    """Have all responses computed with few particles: they are compared with each other."""
    return [replace(hypothesis, coarse=True) for hypothesis in hypotheses]


def _moves(table: Table, hypothesis: Hypothesis) -> bool:
    return any(np.any(changes) for changes in table.response(hypothesis))


def _unusable(table: Table, tried: Sequence[Hypothesis], usable: Sequence[Hypothesis]) -> dict[str, str]:
    """Say of the laws of which nothing can be said why."""
    known, why = {h.effect for h in usable}, dict[str, str]()
    for hypothesis in tried:
        if hypothesis.effect not in known:
            why.setdefault(hypothesis.effect, table.trouble(hypothesis) or SILENT)
    return why


def _diagnosed(motions: Sequence[Motion], diagnosis: Diagnosis) -> list[Motion]:
    """Give the motions of the recordings that were diagnosed.

    They are those that they repeat; others are like as many in turn, elsewhere.
    """
    named, repeats, found = {motion.name: motion for motion in motions}, diagnosis.repeats, list[Motion]()
    for k, name in enumerate(diagnosis.episodes):
        turn = motions[k % len(motions)]
        found.append(named.get(repeats[name], turn) if name in repeats else elsewhere(turn, k))
    return found
