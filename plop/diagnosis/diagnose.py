"""From measured episodes and a base to a verdict: evidence, responses, scores, chances, decision."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from plop.comparison.discretisations import OTHERS, spacing_for
from plop.diagnosis.decision.amplitude import refine
from plop.diagnosis.decision.conclusion import Conclusion, conclude
from plop.diagnosis.decision.finding import worse
from plop.diagnosis.responses.hypotheses import Candidate, base_hypotheses, candidates_of
from plop.diagnosis.responses.repeats import tables_of
from plop.diagnosis.responses.response_table import RunJobs
from plop.diagnosis.responses.table import Measured
from plop.diagnosis.rule import RULE, DecisionRule
from plop.diagnosis.scores.score import Score, one_per_law
from plop.diagnosis.scores.search import Search
from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import EffectType
from plop.tracking.episode import Episode

LEAST_EPISODES = 4
SURVEY_PARTICLES = 400
"""With these all laws are run first, several times faster than with the 1,300 of `identify`. What most laws change
keeps its shape (cosine 0.9 in the median), and its size within a quarter (docs/results/parts.md)."""
REFINED = 4
"""Of the laws that may be the best one, so many are run by the engine itself at the amplitude found even if chance may
have found them."""
ROUNDS = 3
"""How often, at most: a response over its amplitude is a smooth curve, or has one threshold. As often again for laws of
which only the survey has said something so far."""


def diagnose(
    measured: Measured,
    base: EngineBase,
    types: Mapping[str, EffectType],
    run_jobs: RunJobs,
    *,
    reference: Measured | None = None,
    effects: Iterable[str] | None = None,
    sensors: Sequence[str] = (),
    rule: DecisionRule = RULE,
    announce: Callable[[str], None] = lambda step: None,
) -> Conclusion:
    """Find which effect the base is missing.

    Args:
        measured: Episodes to explain.
        base: The engine, calibrated to the reference; it computes the responses.
        types: The library.
        run_jobs: How engine runs are carried out.
        reference: Episodes in which nothing is missing: they show how far the base is off anyway.
        effects: Only these effects; all when absent.
        sensors: Significant sensor faults, in words.
        rule: Error rates and margins.
        announce: Called with what the engine runs that follow are for, in a few words.

    Raises:
        PlopError: Too few episodes, the engine cannot follow any or runs with no law, or a law of the user's has a
            mistake.
    """
    check_enough(len(measured.episodes), {})
    wanted = [*types] if effects is None else list(effects)
    candidates = candidates_of(types, wanted)
    announce("no law")
    given = [measured] if reference is None else [measured, reference]
    tables = tables_of(given, base, run_jobs, survey_of(base, given[-1].episodes))
    check_enough(len(tables[0].episodes), tables[0].dropped)
    announce("every law")
    search = Search(tables, candidates, base_hypotheses(candidates_of(types)))
    _check_laws(search, candidates)
    announce("amplitudes of the best")
    for turn in range(2 * ROUNDS):
        change_p = search.difference.p
        known = change_p is None or change_p <= rule.alarm  # something is missing, or none can tell
        found = [s for s in one_per_law(search.scores()) if s.strength > 0 and (known or s.p <= rule.alarm)]
        near = _may_be_best(found, rule)
        if not refine(search, [s.hypothesis.effect for s in near if turn < ROUNDS or s.hypothesis.coarse]):
            break
    return conclude(search, sensors, rule, whole={*types} <= {c.effect for c in candidates})


def survey_of(base: EngineBase, episodes: list[Episode]) -> EngineBase | None:
    """Give the engine with few particles; None where it has hardly more itself."""
    spacing_m = spacing_for(episodes, SURVEY_PARTICLES)
    return replace(base, spacing_m=spacing_m) if spacing_m > max(OTHERS) * base.spacing_m else None


def _may_be_best(found: Sequence[Score], rule: DecisionRule) -> list[Score]:
    """Find the laws that do as well as the best one, but for chance between episodes and errors of the response."""
    least = (1 - rule.response_error) * found[0].strength if found else 0.0
    near = [s for s in found if s.strength >= least or not worse(found[0], s, rule)]
    return [s for k, s in enumerate(near) if k < REFINED or s.p <= rule.alike]


def _check_laws(search: Search, candidates: list[Candidate]) -> None:
    """Refuse to judge where no law can be run.

    Raises:
        PlopError: The engine runs with none of them.
    """
    laws, failed = {c.effect for c in candidates if c.kind != "base"}, search.failed()
    if laws and laws <= failed.keys():
        raise PlopError(
            "No law could be judged: the engine runs with none of them.",
            found="; ".join(failed.values())[:400],
            fix="Correct the law, or give it a smaller `typical` amplitude.",
        )


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
