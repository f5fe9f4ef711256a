"""Rank all candidates: how much of the error on held-out episodes each explains beyond the base's own parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from plop.diagnosis.candidates import BASE_COLUMNS, Candidate
from plop.diagnosis.evidence import Whitened
from plop.diagnosis.regression import Grams, energy_left, fit, gain, held_out_energy, held_out_values, solve
from plop.statistics.cluster_robust import Clusters

CONFOUNDED_COSINE = 0.95
"""Signatures closer than this, after the base's parameters are taken out, cannot be told apart here."""


@dataclass(frozen=True)
class Score:
    """How one candidate did."""

    candidate: Candidate
    gain: float
    """Share of the held-out error that it takes away, beyond the base's own parameters [-]."""
    gain_error: float
    """Standard error of the gain [-]."""
    before: np.ndarray
    """Held-out sum of squares without it, per episode [E]."""
    after: np.ndarray
    """Held-out sum of squares with it, per episode [E]."""
    null: np.ndarray
    """Columns that were fitted without it, see `Screen.null`."""
    rows: np.ndarray
    """All columns that were fitted: the base's parameters, what was given, and its own, which come last."""
    fit: Clusters
    """Their amplitudes, fitted to all episodes."""
    size_m: float
    """RMS displacement that it makes at the fitted amplitude [m]."""
    alone: float
    """Share of the held-out error that it takes away with the base's own parameters left as they are [-]."""
    shown: np.ndarray
    """Share of all episodes' error that it takes away in each one when fitted to all, none held out, [E]."""

    @property
    def values(self) -> np.ndarray:
        """Fitted amplitudes, one a column of the candidate."""
        return self.fit.values[-len(self.candidate.columns) :]

    @property
    def errors(self) -> np.ndarray:
        """Their standard errors over episodes."""
        return np.sqrt(np.diag(self.fit.spread))[-len(self.candidate.columns) :]


class Screen:
    """Grams of all columns, and the scores made from them."""

    def __init__(self, episodes: list[Whitened], keys: list[str], candidates: list[Candidate]) -> None:
        """Multiply out once.

        Args:
            episodes: At least two.
            keys: Names of the columns of `Whitened.matrix`.
            candidates: Hypotheses whose columns are among them; base parameters included.
        """
        self.episodes, self.keys, self.grams = episodes, keys, Grams.of(episodes)
        self.index = {key: k for k, key in enumerate(keys)}
        own = [column.key for c in candidates if c.effect in BASE_COLUMNS for column in c.columns]
        self.base = np.array([self.index[key] for key in own], int)
        self.candidates = [c for c in candidates if c.effect not in BASE_COLUMNS and self._felt(c)]

    def _felt(self, candidate: Candidate) -> bool:
        rows = self.columns(candidate)
        return bool((np.einsum("ecc->c", self.grams.hessian)[rows] > 0).all())

    def columns(self, candidate: Candidate) -> np.ndarray:
        """Indices of a candidate's columns."""
        return np.array([self.index[c.key] for c in candidate.columns], int)

    def null(self, grams: Grams, given: np.ndarray) -> np.ndarray:
        """Find the columns that a candidate has to do better than: the base's own, refitted, or the base as it is.

        Where one episode misleads the base's parameters, refitting them makes the others worse; a candidate that only
        takes this back explains nothing.

        Args:
            grams: The episodes.
            given: Columns that are fitted in any case.
        """
        refitted = np.concatenate([self.base, given])
        worse = held_out_energy(grams, refitted).sum() > held_out_energy(grams, given).sum()
        return given if worse else refitted

    def before(self, grams: Grams | None = None) -> np.ndarray:
        """Held-out sum of squares without any candidate, [E]."""
        grams = grams or self.grams
        return held_out_energy(grams, self.null(grams, np.array([], int)))

    def refitted(self) -> np.ndarray:
        """Held-out sum of squares with the base's own parameters refitted, [E]."""
        return held_out_energy(self.grams, self.base)

    def scores(self, response_rms_m: Callable[[str], float], given: Candidate | None = None) -> list[Score]:
        """Score every candidate, best first.

        Args:
            response_rms_m: RMS response of one unit of a column [m].
            given: A law that is taken for granted: the others are scored on what it leaves.
        """
        taken = np.array([], int) if given is None else self.columns(given)
        null = self.null(self.grams, taken)
        before, found = held_out_energy(self.grams, null), []
        for candidate in self.candidates:
            if given is not None and candidate.effect == given.effect:
                continue
            rows = np.concatenate([self.base, taken, self.columns(candidate)])
            after = held_out_energy(self.grams, rows)
            fitted = fit(self.grams, rows)
            alone = gain(self.grams.energy, held_out_energy(self.grams, self.columns(candidate)))
            values = fitted.values[-len(candidate.columns) :]
            sizes = [abs(v) * response_rms_m(c.key) for v, c in zip(values, candidate.columns, strict=True)]
            found.append(
                Score(
                    candidate,
                    gain(before, after),
                    self.gain_error(null, rows),
                    before,
                    after,
                    null,
                    rows,
                    fitted,
                    float(np.hypot.reduce(sizes)),
                    alone,
                    self._shown(null, rows),
                )
            )
        return sorted(found, key=lambda s: -s.gain)

    def _shown(self, less: np.ndarray, more: np.ndarray) -> np.ndarray:
        before = energy_left(self.grams, less)
        return np.asarray((before - energy_left(self.grams, more)) / max(before.sum(), 1e-30))

    def gain_error(self, less: np.ndarray, more: np.ndarray) -> float:
        """Give the standard error of the gain of some columns over others [-].

        The parts of the object in each episode are what counts as independent; episodes are strata, because
        some motions show an effect and others cannot.
        """
        return _gain_error(self.held_out_blocks(less), self.held_out_blocks(more))

    def held(self, score: Score, values: np.ndarray) -> Score:
        """Score a candidate at given amplitudes [C] instead of the fitted ones; everything else is refitted."""
        others, own = score.rows[: -len(values)], score.rows[-len(values) :]
        rest = self.with_residuals([e.residual - values @ e.matrix[own] for e in self.episodes])
        after = held_out_energy(rest.grams, others)
        error = _gain_error(self.held_out_blocks(score.null), rest.held_out_blocks(others))
        return replace(score, gain=gain(score.before, after), gain_error=error, after=after)

    def with_residuals(self, residuals: Sequence[np.ndarray]) -> Screen:
        """Put other residuals [D] in the place of each episode's; the responses stay."""
        other = copy(self)
        other.episodes = [replace(e, residual=r) for e, r in zip(self.episodes, residuals, strict=True)]
        other.grams = self.grams.with_residuals(other.episodes)
        return other

    def held_out_blocks(self, columns: np.ndarray) -> np.ndarray:
        """Sum of squares left in each part of each episode when the columns were fitted to the others, [E, BLOCKS]."""
        values = held_out_values(self.grams, columns)
        return np.stack(
            [e.by_block((e.residual - v @ e.matrix[columns]) ** 2) for e, v in zip(self.episodes, values, strict=True)]
        )

    def best_gain(self, grams: Grams) -> float:
        """Largest gain over the library, for shams."""
        before = self.before(grams)
        return max(
            (
                gain(before, held_out_energy(grams, np.concatenate([self.base, self.columns(c)])))
                for c in self.candidates
            ),
            default=0.0,
        )

    def signature(self, candidate: Candidate, values: np.ndarray) -> np.ndarray:
        """Response of a candidate without what the base's parameters can do, all episodes in a row, unit length."""
        rows = self.columns(candidate)
        total = self.grams.hessian.sum(0)
        response = [np.tensordot(values, e.matrix[rows], 1) for e in self.episodes]
        if len(self.base):
            mix = solve(total[np.ix_(self.base, self.base)], total[np.ix_(self.base, rows)] @ values)
            response = [
                r - np.tensordot(mix, e.matrix[self.base], 1) for r, e in zip(response, self.episodes, strict=True)
            ]
        flat = np.concatenate(response)
        return flat / max(float(np.linalg.norm(flat)), 1e-30)


def _gain_error(before: np.ndarray, after: np.ndarray) -> float:
    """Standard error of a gain, from the sums of squares in each part of each episode, [E, BLOCKS]."""
    spread = (before - after).var(1, ddof=1).sum() * before.shape[1]
    return float(np.sqrt(spread) / max(before.sum(), 1e-30))


def one_per_effect(scores: list[Score]) -> list[Score]:
    """Keep the best setting of each effect, best first."""
    seen: dict[str, Score] = {}
    for score in scores:
        seen.setdefault(score.candidate.effect, score)
    return list(seen.values())


def worse_than(best: Score, other: Score) -> tuple[float, float]:
    """Give how much more of the held-out error another one leaves, and its standard error over episodes."""
    worse = other.after - best.after
    return float(worse.sum()), float(np.std(worse, ddof=1) * np.sqrt(len(worse)))


def confounded(screen: Screen, best: Score, others: list[Score]) -> list[Score]:
    """Find the effects that these recordings cannot tell from the best one.

    Either their signatures coincide, or they explain the held-out error as well: the difference in held-out
    error is less than two standard errors over episodes, and they keep at least 70 % of the gain.
    """
    mine, found = screen.signature(best.candidate, best.values), []
    for other in others:
        if other.candidate.effect == best.candidate.effect or other.gain <= 0:
            continue
        cosine = abs(float(mine @ screen.signature(other.candidate, other.values)))
        worse, error = worse_than(best, other)
        unclear = worse < 2 * error and other.gain > 0.7 * best.gain
        if cosine > CONFOUNDED_COSINE or unclear:
            found.append(other)
    return found
