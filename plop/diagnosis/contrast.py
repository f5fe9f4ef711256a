"""Does an effect have another amplitude here than in the reference recordings, where nothing is missing?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from plop.diagnosis.regression import Fit, Grams, fit, solve
from plop.diagnosis.strata import strata_of, told_apart

P_LARGEST = 0.02
"""Family-wise chance of a false alarm up to which an effect is named."""
_SHRINK = 0.1
"""Episodes' worth of the reference's overall amplitude that is mixed into that of each kind of motion."""


@dataclass(frozen=True)
class Contrast:
    """An amplitude against that in the reference; episodes are what counts as independent."""

    errors: float
    """Distance in standard errors."""
    p: float
    """Chance of such a distance for any effect of the library when none has changed."""
    least: float
    """Smallest change of the first amplitude that would be clear."""


@dataclass(frozen=True)
class _Test:
    """One way of comparing amplitudes."""

    errors: float
    """Distance in standard errors."""
    p: float
    """Chance of it when nothing has changed, for one hypothesis."""
    unit: float
    """Standard error of the first amplitude's difference."""
    freedom: float


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
    tests = [_overall(*fits, own)]
    strata = strata_of(*kinds)
    if told_apart(strata):
        tests.append(_within_kinds(_profiled((here, reference), fits, rows, own), strata, own))
    times = family * len(tests)
    best = min(tests, key=lambda test: (test.p, -test.errors))
    least = min(float(student.isf(P_LARGEST / (2 * times), test.freedom)) * test.unit for test in tests)
    return Contrast(best.errors, min(1.0, times * best.p), least)


def _overall(here: Fit, reference: Fit, own: int) -> _Test:
    """Compare two pooled fits; the degrees of freedom are Welch's (Biometrika 34, 1947)."""
    parts = here.spread[-own:, -own:], reference.spread[-own:, -own:]
    spread = parts[0] + parts[1]
    difference = here.values[-own:] - reference.values[-own:]
    squared = float(difference @ np.linalg.pinv(spread) @ difference / own)
    freedom = [
        np.diag(part) ** 2 / max(fit.episodes - 1, 1) for part, fit in zip(parts, (here, reference), strict=True)
    ]
    degrees = float((np.diag(spread) ** 2 / np.maximum(freedom[0] + freedom[1], 1e-300)).min())
    degrees = max(degrees, 1.0)
    p = float(fisher.sf(squared, own, degrees))
    return _Test(float(np.sqrt(squared)), p, float(np.sqrt(spread[0, 0])), degrees)


def _within_kinds(sides: tuple[_Side, _Side], strata: tuple[list[str], list[str]], own: int) -> _Test:
    """Compare each episode with the reference episodes of its kind; only the scatter within kinds counts.

    Both sets tell that scatter: when nothing has changed they are of one kind each. An episode's weight is its
    sensitivity.
    """
    scores, spreads, scatter, degrees = np.zeros(own), np.zeros((own, own)), np.zeros((own, own)), 0
    total = sides[0].hessian.sum(0)
    typical = _SHRINK * sides[1].hessian.mean(0)
    everywhere = solve(sides[1].hessian.sum(0), sides[1].gradient.sum(0))
    cells = []
    for label in dict.fromkeys(strata[0]):
        mine, other = (side.chosen([k == label for k in names]) for side, names in zip(sides, strata, strict=True))
        amplitude = solve(other.hessian.sum(0) + typical, other.gradient.sum(0) + typical @ everywhere)
        for part in (mine, other):
            white = part.whitened(amplitude)
            centred = white - white.mean(0)
            scatter += centred.T @ centred
            degrees += len(white) - 1
        scores += (mine.gradient - mine.hessian @ amplitude).sum(0)
        cells.append((mine, other))
    scatter /= degrees
    for mine, other in cells:
        spreads += mine.spread(scatter)
        carried = mine.hessian.sum(0) @ np.linalg.pinv(other.hessian.sum(0) + typical)
        spreads += carried @ other.spread(scatter) @ carried.T
    difference = solve(total, scores)
    inverse = np.linalg.pinv(total)
    spread = inverse @ spreads @ inverse.T
    squared = float(difference @ np.linalg.pinv(spread) @ difference / own)
    freedom = max(degrees - own + 1, 1)
    p = float(fisher.sf(squared * freedom / degrees, own, freedom))
    return _Test(float(np.sqrt(squared)), p, float(np.sqrt(spread[0, 0])), freedom)


@dataclass(frozen=True)
class _Side:
    """Own amplitudes of one set of episodes, free of what the base's parameters explain."""

    hessian: np.ndarray
    """[E, own, own]."""
    gradient: np.ndarray
    """[E, own]."""

    def chosen(self, which: Sequence[bool]) -> _Side:
        rows = np.flatnonzero(which)
        return _Side(self.hessian[rows], self.gradient[rows])

    def whitened(self, amplitude: np.ndarray) -> np.ndarray:
        """Deviation of each episode from an amplitude, in units in which all episodes scatter alike, [E, own]."""
        left = self.gradient - self.hessian @ amplitude
        return np.stack([np.linalg.solve(_root(h), r) for h, r in zip(self.hessian, left, strict=True)])

    def spread(self, scatter: np.ndarray) -> np.ndarray:
        """Covariance of the sum of the episodes' gradients."""
        roots = [_root(h) for h in self.hessian]
        return np.asarray(sum(root @ scatter @ root.T for root in roots))


def _root(hessian: np.ndarray) -> np.ndarray:
    ridge = 1e-6 * float(np.trace(hessian)) / len(hessian) + 1e-30
    return np.linalg.cholesky(hessian + ridge * np.eye(len(hessian)))


def _profiled(
    grams: tuple[Grams, Grams], fits: tuple[Fit, Fit], rows: np.ndarray, own: int
) -> tuple[_Side, _Side]:  # fmt: skip
    """Take out of the own columns what the base's columns explain, and of the residuals what they fit."""
    base, last = rows[:-own], rows[-own:]
    pooled = sum((each.hessian.sum(0) for each in grams), np.zeros(()))
    shared = np.zeros((len(base), own))
    if len(base):
        stacked = np.broadcast_to(pooled[np.ix_(base, base)], (own, len(base), len(base)))
        shared = solve(stacked, pooled[np.ix_(base, last)].T).T

    def side(part: Grams, fitted: Fit) -> _Side:
        cross = part.hessian[:, last][:, :, base] - shared.T @ part.hessian[:, base][:, :, base]
        gradient = part.gradient[:, last] - part.gradient[:, base] @ shared - cross @ fitted.values[: len(base)]
        hessian = part.hessian[:, last][:, :, last] - 2 * _symmetric(part.hessian[:, last][:, :, base] @ shared)
        return _Side(hessian + shared.T @ part.hessian[:, base][:, :, base] @ shared, gradient)

    return side(grams[0], fits[0]), side(grams[1], fits[1])


def _symmetric(matrices: np.ndarray) -> np.ndarray:
    return (matrices + matrices.swapaxes(-1, -2)) / 2
