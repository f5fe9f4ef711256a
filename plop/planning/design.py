"""Recordings that are not made yet, as a diagnosis would see them: motions, how often, and draws of the evidence.

Under the discrepancy model the products onto = R' P r of responses and residuals (see `contrast`) are Gaussian with
covariance G = R' P R, for all hypotheses and episodes together; a law that is there adds G z times its amount. So that
a whole diagnosis, with every way of dealing the episodes out, can be drawn many times over without an engine run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpstrf

from plop.diagnosis.evidence.contrast import Products
from plop.diagnosis.evidence.discrepancy import Field
from plop.diagnosis.rule import DecisionRule
from plop.diagnosis.scores.calibration import ByChance, balanced, strongest, ways_to_deal
from plop.diagnosis.scores.search import ENOUGH_WAYS
from plop.planning.motions import Motion

DRAWS = 40
"""Draws of the evidence: nine in ten is then known to 5 %."""
WAYS = 500
"""Ways of dealing the episodes out by which a draw says what chance finds, at most."""


class Design:
    """Motions to record in an object to explain, and in the reference."""

    def __init__(
        self, here: Sequence[Motion], reference: Sequence[Motion], seed: int = 0, hidden: int | None = None
    ) -> None:
        """Multiply all responses over the covariance that these recordings would have.

        Args:
            here: Motions of the recordings to explain; one that is repeated is listed as often. E with the reference.
            reference: Those in which nothing is missing.
            seed: Of the draws.
            hidden: Column of a law that is in the recordings to explain when the weights of the noise are found: so a
                diagnosis finds them, and what a large law does where the base is no match for it counts for less.
        """
        motions = [*(m if hidden is None else _with(m, hidden) for m in here), *reference]
        self.here = np.arange(len(motions)) < len(here)
        self.kinds = [motion.kind for motion in motions]
        self._seed = seed
        field = Field([m.evidence for m in motions], [m.base for m in motions])
        columns = [np.stack([r.reshape(-1) for r in m.responses], 1) for m in motions]
        self._repeats = field.repeats
        self.gram = field.multiplied(columns, [m.evidence.residual for m in motions])[0]
        """Of all hypotheses, [E, H, E, H]."""

    @cached_property
    def ways(self) -> np.ndarray:
        """Ways of dealing the episodes out, as the diagnosis would, [N, E]."""
        return ways_to_deal(self.here, self.kinds, ENOUGH_WAYS)

    @cached_property
    def draws(self) -> np.ndarray:
        """Products with residuals in which nothing is hidden, [DRAWS, E, H]."""
        count, wide = self.gram.shape[:2]
        # responses that resemble each other make it singular, so that pivots are needed
        root, pivots, rank, _ = dpstrf(self.gram.reshape(count * wide, count * wide), lower=1)
        drawn = np.random.default_rng(self._seed).normal(size=(DRAWS, rank))
        found = np.empty((DRAWS, count * wide))
        found[:, pivots - 1] = drawn @ np.tril(root)[:, :rank].T
        return found.reshape(DRAWS, count, wide)

    def products(
        self, draw: int, hypothesis: int, hidden: int | None = None, amount: float | np.ndarray = 0.0
    ) -> Products:
        """Give what a draw says of a hypothesis.

        Args:
            draw: Which.
            hypothesis: Its column.
            hidden: Column of a law that is there in the recordings to explain; None: nothing is.
            amount: How much of it, in all or in each episode, [E].
        """
        onto = self.draws[draw][:, hypothesis]
        if hidden is not None:
            onto = onto + self.gram[:, hypothesis, :, hidden] @ (amount * self.here)
        return Products(self.gram[:, hypothesis, :, hypothesis], onto, self._repeats)

    @cached_property
    def by_chance(self) -> list[ByChance]:
        """What chance finds in each draw, for ways of dealing the episodes out; nothing is there to be taken off."""
        ways = balanced(self.ways)
        few = ways[np.unique(np.linspace(0, len(ways) - 1, WAYS).round().astype(int))]
        laws = range(self.gram.shape[1])
        found = [strongest([self.products(draw, h) for h in laws], few) for draw in range(DRAWS)]
        return [ByChance(ways, len(laws), len(self.here)) for ways in found]

    def critical(self, hypothesis: int, rule: DecisionRule) -> np.ndarray:
        """Strength of a hypothesis that chance exceeds as rarely as it may, in each draw, [DRAWS]."""
        freedom = self.products(0, hypothesis).freedom
        return np.array([found.critical(rule.alarm, freedom) for found in self.by_chance])

    def factors(self, rule: DecisionRule) -> np.ndarray:
        """How much more strongly an object responds than the engine says, in each draw, [DRAWS] [-]."""
        drawn = np.random.default_rng(self._seed + 1).normal(1.0, rule.response_error, DRAWS)
        return np.asarray(np.maximum(drawn, 0.0))

    def amounts(self, rule: DecisionRule) -> np.ndarray:
        """The same in each episode: from motion to motion it scatters by as much again, [DRAWS, E] [-]."""
        motion = np.maximum(self._repeats, np.eye(len(self.here))).argmax(1)
        drawn = np.random.default_rng(self._seed + 2).normal(1.0, rule.response_error, (DRAWS, len(motion)))
        return np.asarray(self.factors(rule)[:, None] * drawn[:, motion])


def _with(motion: Motion, column: int) -> Motion:
    """Let a motion be recorded with a law in it."""
    evidence = motion.evidence
    residual = evidence.residual + evidence.seen[..., None] * motion.responses[column]
    return replace(motion, evidence=replace(evidence, residual=residual))
