"""Do the recordings differ from the reference, whatever by: a field common to them, or a base that is further off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plop.diagnosis.evidence.description import Description, describe
from plop.diagnosis.evidence.discrepancy import Field, Spread, missed2
from plop.diagnosis.evidence.evidence import Evidence
from plop.diagnosis.scores.calibration import chance
from plop.diagnosis.scores.misfit import differences, misfits, outlying
from plop.diagnosis.scores.unknown import Unknown
from plop.statistics.heavy_tails import FREEDOM


@dataclass(frozen=True, eq=False)
class Difference:
    """What is in the episodes to explain beyond the reference; computed when asked for."""

    field: Field
    evidence: Sequence[Evidence]
    """Of all episodes, E."""
    residuals: Sequence[np.ndarray]
    """What is left of each without the laws that were found, [F, K, 3] [m]."""
    left: Sequence[np.ndarray]
    """The same with the base refitted."""
    here: np.ndarray
    """Which episodes are to be explained, bool [E]."""
    ways: np.ndarray
    """Ways of dealing the episodes out, the real one first, [N, E]."""
    kinds: Sequence[str]
    """Kind of motion of every episode."""
    spread: Spread
    """How large each part of the discrepancy is."""

    @cached_property
    def p(self) -> float | None:
        """Chance that recordings and reference differ as much where nothing is hidden, in either of two ways.

        None without reference.
        """
        return None if self.here.all() else min(1.0, 2 * min(self.field_p, self.size_p))

    @cached_property
    def field_p(self) -> float:
        """Chance that a smooth field explains as much; 1 where, held out, it predicts nothing."""
        if self.gain <= 0:
            return 1.0
        evidence = self._unknown.evidence(self.ways)
        return chance(float(evidence[0] - evidence.min()), evidence - evidence.min())

    @cached_property
    def size_p(self) -> float:
        """Chance that the recordings are explained less well than the reference by as much."""
        found = differences(self._misfits, self.ways, self.kinds)
        return chance(float(found[0]), found) if found[0] > 0 else 1.0

    @cached_property
    def gain(self) -> float:
        """Gain of log density by a field that is in the recordings alone, held out [nats]."""
        return float(self._unknown.held_out(self.here).sum())

    @cached_property
    def common(self) -> float:
        """Share that such a field predicts of what a field of its own would explain in each recording [-]."""
        alone = self._unknown.alone(self.here)
        return self.gain / alone if alone > 0 else 0.0

    def alone(self, chance: float) -> list[str]:
        """Name the recordings that are explained far less well than any other of their motion."""
        return [self.evidence[k].name for k in outlying(self._misfits, self.here, self.kinds, chance)]

    def described(self) -> Description:
        """Say where, when and in which direction the difference is."""
        return describe(list(self.left), list(self.evidence), list(self.kinds), self.here)

    @cached_property
    def _unknown(self) -> Unknown:
        return Unknown.of(self.field, self.residuals)

    @cached_property
    def _misfits(self) -> np.ndarray:
        """Misfit of every episode, see `misfit`, [E]."""
        seen = [e.seen.reshape(-1) for e in self.evidence]
        left = [(each.reshape(-1, 3) ** 2).sum(1) for each in self.left]
        noise = [e.variance_m2.reshape(-1) for e in self.evidence]
        missed = [missed2(e, self.spread) for e in self.evidence]
        left, noise, missed = ([part[s] for part, s in zip(each, seen, strict=True)] for each in (left, noise, missed))
        return misfits(left, noise, missed, FREEDOM)
