"""How much of a law is there: found with the weights that it leaves, where its response was computed.

A response is in proportion to the amplitude near the one at which it was computed only, so that a law that was found
elsewhere is run anew there.
"""

from __future__ import annotations

from collections.abc import Sequence

from plop.diagnosis.finding import Curve
from plop.diagnosis.hypotheses import Hypothesis
from plop.diagnosis.score import Score, one_per_setting
from plop.diagnosis.search import Search

NEAR = 0.15
"""An amplitude is found where the response was computed within this share of it."""
_TURNS = 5
"""Rounds in which amplitude and weights are found from each other."""
_FLATTEST = 16.0
"""How many times smaller or larger than what was found an amplitude is looked at."""


def refine(search: Search, laws: Sequence[str]) -> bool:
    """Run some laws at the amplitudes that were found, where these are not near those that were run.

    Returns:
        Whether there was anything to run.
    """
    wanted = []
    for score in one_per_setting(search.scores()):
        if score.hypothesis.effect not in laws or score.amount == 0:
            continue
        multiple = min(score.amount, score.hypothesis.most)
        if abs(multiple - 1) > NEAR or len(score.hypothesis.runs) > 1:
            wanted.append(score.hypothesis.at(multiple))
    known = {h.key for h in search.hypotheses if len(h.runs) == 1}
    new = [h for h in wanted if h.key not in known]
    search.add(new)
    return bool(new)


def settled(search: Search, score: Score) -> tuple[Search, Score]:
    """Find the amplitude of a law with the weights that it leaves: the one of several at which it explains most.

    A response that changes its shape with the amplitude, as that of a friction which holds where less of it slips, may
    repeat itself at one amplitude and explain more at another. So twice and half of what was found are tried.

    Returns:
        The search with these weights, and the score there, with the chance of the search as it was.
    """
    weighted, found = _repeated(search, score)
    for factor in (2.0, 0.5):
        for _ in range(_TURNS):
            start = _elsewhere(search, found.hypothesis, factor)
            if start is None:
                break
            trial, other = _repeated(search, weighted.score_of(start, score.p))
            if weighted.score_of(other.hypothesis, score.p).strength <= found.strength:
                break
            weighted, found = trial, other
    return weighted, found


def _elsewhere(search: Search, hypothesis: Hypothesis, factor: float) -> Hypothesis | None:
    """Run a law at a multiple of its amplitude; None beyond its range, or where the engine fails."""
    other = hypothesis.at(factor)
    if factor > hypothesis.most:
        return None
    search.add([other] if other.key not in {h.key for h in search.hypotheses if len(h.runs) == 1} else [])
    return other if other in search.hypotheses else None


def _repeated(search: Search, score: Score) -> tuple[Search, Score]:
    """Run a law anew at the amplitude that was found, until that repeats itself, with the weights that it leaves."""
    weighted, found = search, score
    for _ in range(_TURNS):
        trial = search.reweighted(found)
        new = trial.score_of(found.hypothesis, score.p)
        if new.strength <= 0:
            break
        weighted, found = trial, new
        multiple = min(new.amount, new.hypothesis.most)
        moved = None if abs(multiple - 1) <= NEAR else _elsewhere(search, new.hypothesis, multiple)
        if moved is None:
            break
        found = trial.score_of(moved, score.p)
    return weighted, found


def curve_of(search: Search, score: Score, width: float) -> Curve:
    """Find the size of a law's response over its amplitude, around the one that was found.

    Args:
        search: May run the law at more amplitudes.
        score: A law at the amplitude where its response was computed.
        width: Share of the response by which it may be off: the curve reaches so far, where the range lets it.
    """
    points = {1.0: 1.0}
    for factor, far in ((0.5, lambda size: size <= 1 - width), (2.0, lambda size: size >= 1 + width)):
        multiple = 1.0
        while not far(points[multiple]) and 1 / _FLATTEST < multiple < _FLATTEST:
            other = _elsewhere(search, score.hypothesis, factor * multiple)
            if other is None:
                break
            multiple *= factor
            points[multiple] = _size(search, score.hypothesis, other)
    return Curve(tuple(sorted(points.items())))


def _size(search: Search, hypothesis: Hypothesis, other: Hypothesis) -> float:
    """Give how much of a response another one shows: its projection on the first, in units of that."""
    pairs = list(zip(search.tables[0].response(hypothesis), search.tables[0].response(other), strict=True))
    return float(sum((a * b).sum() for a, b in pairs) / sum((a * a).sum() for a, _ in pairs))
