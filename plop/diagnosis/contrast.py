"""Does an effect have another amplitude here than in the reference recordings, where nothing is missing?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from plop.diagnosis.regression import Grams, fit, solve
from plop.diagnosis.strata import strata_of, told_apart
from plop.statistics.cluster_robust import Clusters, clusters, loudness, root, steadied, together, whitened

P_LARGEST = 0.02
"""Family-wise chance of a false alarm up to which an effect is named."""
MOSTLY = float(norm.ppf(0.9))
"""Standard errors by which an effect must exceed what is asked for, to be seen nine times in ten."""
_SHRINK = 0.1
"""Episodes' worth of the reference's overall amplitude that is mixed into that of each kind of motion."""


@dataclass(frozen=True)
class Contrast:
    """An amplitude against that in the reference; episodes are what counts as independent."""

    errors: float
    """Distance in standard errors."""
    p: float
    """Chance of such a distance for any effect of the library when none has changed."""
    least: np.ndarray
    """Smallest change of each amplitude that would be clear, and would come out so nine times in ten, [own]."""
    least_alone: np.ndarray
    """The same where the error by itself shows that something is missing: the law is then the only hypothesis."""


@dataclass(frozen=True)
class _Test:
    """One way of comparing amplitudes."""

    errors: float
    """Distance in standard errors."""
    p: float
    """Chance of it when nothing has changed, for one hypothesis."""
    unit: np.ndarray
    """Standard error of each amplitude's difference, [own]."""
    freedom: np.ndarray
    """[own]."""

    def least(self, p: float) -> np.ndarray:
        """Give the change of each amplitude that has such a chance, and comes out so nine times in ten, [own]."""
        return np.asarray((student.isf(p / 2 / len(self.unit), self.freedom) + MOSTLY) * self.unit)


def contrast_of(
    here: Grams, reference: Grams, rows: np.ndarray, own: int, family: int, kinds: tuple[Sequence[str], Sequence[str]]
) -> Contrast:
    """Compare the last `own` amplitudes of a set of columns between two sets of episodes.

    Two tests: over all episodes, each weighing as much as its data say, and within kinds of motion. What the base
    misses by itself depends on the kind, and so does the amplitude that this resembles; which test sees more depends
    on where an effect shows. The smaller p counts, times the number of tests and of hypotheses (Bonferroni).

    Args:
        here: The episodes to explain.
        reference: The reference.
        rows: Columns, the base's own parameters first.
        own: Number of amplitudes to compare, the last ones.
        family: Hypotheses among which the best is looked for.
        kinds: Kind of motion of every episode, here and in the reference.
    """
    fits = fit(here, rows), fit(reference, rows)
    last = np.eye(len(rows))[-own:]
    tests = [_judged([fits[0].mapped(last), fits[1].mapped(-last)])]
    strata = strata_of(*kinds)
    if told_apart(strata):
        tests.append(_within_kinds(_profiled((here, reference), fits, rows, own), strata))
    times = family * len(tests)
    best = min(tests, key=lambda test: (test.p, -test.errors))
    least, least_alone = (
        np.min([test.least(P_LARGEST / number) for test in tests], 0) for number in (times, len(tests))
    )
    return Contrast(best.errors, min(1.0, times * best.p), least, least_alone)


def _judged(parts: Sequence[Clusters]) -> _Test:
    """Test whether differences are zero, each by a t test along axes that do not depend on each other (Bonferroni).

    Args:
        parts: What the differences are the sum of, each told by other episodes.
    """
    difference = together(parts)
    own = len(difference.values)
    apart = _inverse_root(difference.whole)
    variances, freedom = _steadied([part.mapped(apart) for part in parts])
    errors = np.abs(apart @ difference.values) / np.sqrt(np.maximum(variances, 1e-300))
    p = own * 2 * student.sf(errors, freedom)
    best = int(np.argmin(p))
    variances, freedom = _steadied(parts)
    return _Test(float(errors[best]), min(1.0, float(p[best])), np.sqrt(variances), freedom)


def _steadied(parts: Sequence[Clusters]) -> tuple[np.ndarray, np.ndarray]:
    """Give variances of a sum [C] and their degrees of freedom [C], see `Clusters.steadied`.

    The sum's own degrees of freedom are counted by what episodes hold, or by how they scatter if that gives fewer
    (Welch, Biometrika 34, 1947).
    """
    whole = together(parts)
    spreads = np.stack([np.diag(part.pulls.T @ part.pulls) for part in parts])
    each = np.stack([part.freedom for part in parts])
    welch = spreads.sum(0) ** 2 / np.maximum((spreads**2 / each).sum(0), 1e-300)
    expected = np.sum([part.scatter * np.diag(part.likely) for part in parts], 0)
    return steadied(np.diag(whole.spread), np.maximum(np.minimum(whole.freedom, welch), 1.0), expected)


def _inverse_root(matrix: np.ndarray) -> np.ndarray:
    sizes, axes = np.linalg.eigh(matrix)
    return np.asarray(axes / np.sqrt(np.maximum(sizes, 1e-12 * max(float(sizes[-1]), 1e-300))) @ axes.T)


def _within_kinds(sides: tuple[_Side, _Side], strata: tuple[list[str], list[str]]) -> _Test:
    """Compare each episode with the reference episodes of its kind; only the scatter within kinds counts.

    An episode that is the only one of its kind does not tell how such episodes scatter: it is taken to scatter as the
    others do within theirs, as far as it is sensitive.
    """
    total = sides[0].hessian.sum(0)
    prior = _SHRINK * sides[1].hessian.mean(0), solve(sides[1].hessian.sum(0), sides[1].gradient.sum(0))
    loud = np.split(loudness(np.concatenate([side.hessian for side in sides])), [len(sides[0].hessian)])
    parts, lone, tellers = [], [], []
    for label in dict.fromkeys(strata[0]):
        chosen = [np.flatnonzero([k == label for k in names]) for names in strata]
        mine, other = (side.chosen(which) for side, which in zip(sides, chosen, strict=True))
        weight = np.linalg.solve(_ridged(total), mine.hessian.sum(0))
        theirs = [each[which] for each, which in zip(loud, chosen, strict=True)]
        for side, known, share, own in ((mine, None, weight, theirs[0]), (other, prior, -weight, theirs[1])):
            fitted = clusters(side.hessian, side.gradient, known, own)
            parts.append(fitted.mapped(share))
            if len(side.hessian) > 1:
                tellers.append(whitened(fitted, side.hessian))
            else:
                lone.append((len(parts) - 1, share @ fitted.inverse @ root(side.hessian[0]), float(own[0])))
    told = together(tellers)
    for place, carried, loud_alone in lone:
        parts[place] = replace(told.averaged(carried, loud_alone), values=parts[place].values)
    return _judged([replace(part, scatter=told.scatter) for part in parts])


@dataclass(frozen=True)
class _Side:
    """Own amplitudes of one set of episodes, free of what the base's parameters explain."""

    hessian: np.ndarray
    """[E, own, own]."""
    gradient: np.ndarray
    """[E, own]."""

    def chosen(self, which: np.ndarray) -> _Side:
        return _Side(self.hessian[which], self.gradient[which])


def _profiled(
    grams: tuple[Grams, Grams], fits: tuple[Clusters, Clusters], rows: np.ndarray, own: int
) -> tuple[_Side, _Side]:
    """Take out of the own columns what the base's columns explain, and of the residuals what they fit."""
    base, last = rows[:-own], rows[-own:]
    pooled = sum((each.hessian.sum(0) for each in grams), np.zeros(()))
    shared = np.zeros((len(base), own))
    if len(base):
        stacked = np.broadcast_to(pooled[np.ix_(base, base)], (own, len(base), len(base)))
        shared = solve(stacked, pooled[np.ix_(base, last)].T).T

    def side(part: Grams, fitted: Clusters) -> _Side:
        cross = part.hessian[:, last][:, :, base] - shared.T @ part.hessian[:, base][:, :, base]
        gradient = part.gradient[:, last] - part.gradient[:, base] @ shared - cross @ fitted.values[: len(base)]
        hessian = part.hessian[:, last][:, :, last] - 2 * _symmetric(part.hessian[:, last][:, :, base] @ shared)
        return _Side(hessian + shared.T @ part.hessian[:, base][:, :, base] @ shared, gradient)

    return side(grams[0], fits[0]), side(grams[1], fits[1])


def _ridged(matrix: np.ndarray) -> np.ndarray:
    return np.asarray(matrix + (1e-9 * float(np.trace(matrix)) / len(matrix) + 1e-30) * np.eye(len(matrix)))


def _symmetric(matrices: np.ndarray) -> np.ndarray:
    return (matrices + matrices.swapaxes(-1, -2)) / 2
