"""How much of a law is there: found with the weights that it leaves, where its response was computed.

A response is in proportion to the amplitude near the one at which it was computed only, so that a law that was found
elsewhere is run anew there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from plop.diagnosis.decision.finding import Curve
from plop.diagnosis.responses.hypotheses import Hypothesis
from plop.diagnosis.scores.score import Score, one_per_setting
from plop.diagnosis.scores.search import Search

NEAR = 0.05
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
        other = score.hypothesis.with_values(score.values)
        if _computed_near(search, other) is None:
            wanted.append(other)
    search.add(wanted)
    return bool(wanted)


def _computed_near(search: Search, wanted: Hypothesis) -> Hypothesis | None:
    """Give the law at the nearest amplitudes at which the engine was run, if they are near."""
    own = [h for h in search.hypotheses if h.candidate == wanted.candidate and len(h.runs) == 1 and not h.coarse]
    return min((h for h in own if _apart(h, wanted) <= NEAR), key=lambda h: _apart(h, wanted), default=None)


def _apart(one: Hypothesis, other: Hypothesis) -> float:
    """Give the distance of two amplitudes of a law, as a share of the second."""
    first, second = np.array(one.values), np.array(other.values)
    return float(np.linalg.norm(first - second) / np.linalg.norm(second))


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
    search.add([other])
    return other if other in search.hypotheses else None


def _repeated(search: Search, score: Score) -> tuple[Search, Score]:
    """Find the amplitude at which the recordings show the response once, with the weights that the law leaves."""
    weighted, found, tried = search, score, list[tuple[float, float]]()
    for _ in range(_TURNS):
        trial = search.reweighted(found)
        new = trial.score_of(found.hypothesis, score.p)
        if new.strength <= 0 or new.amount <= 0:
            break
        weighted, found = trial, new
        aimed = new.hypothesis.with_values(new.values)
        if _apart(new.hypothesis, aimed) <= NEAR and not new.hypothesis.coarse:
            break
        was, size = (float(np.linalg.norm(h.values)) for h in (new.hypothesis, aimed))
        tried.append((float(np.log(was)), float(np.log(size / was))))
        wanted = aimed.at(float(np.exp(_step(tried))) * was / size)
        moved = _computed_near(search, wanted) or _elsewhere(search, wanted, 1.0)
        if moved is None or moved == new.hypothesis:
            break
        found = trial.score_of(moved, score.p)
    return weighted, found


def _step(tried: Sequence[tuple[float, float]]) -> float:
    """Choose where to look next, from logarithms of amplitudes and of how many times the response shows there.

    As far as the last one says, were the response in proportion; between two of which one says more and the other less,
    where a line through both says neither (regula falsi): a friction that holds up to some amplitude jumps.

    Returns:
        Logarithm of the factor by which to change the last amplitude.
    """
    *others, (place, amount) = tried
    beyond = [(x, y) for x, y in others if x != place and y * amount < 0]
    if not beyond:
        return amount
    x, y = min(beyond, key=lambda point: abs(point[0] - place))
    return (x - place) * amount / (amount - y)


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
