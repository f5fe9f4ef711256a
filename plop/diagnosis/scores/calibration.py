"""How often a search finds as much where nothing is hidden: the whole search, on the same episodes dealt out anew.

If nothing is hidden, recordings and reference are alike but for their motions, and any of the ways of dealing the
episodes out into two such sets might have been the real one (Fisher 1935; Pitman 1937). Each way is searched as the
real one is, over all laws and amplitudes (Westfall & Young 1993): that gives the scale of what chance finds, whatever
the base misses and however it errs.

The rank of the real way would be exact, but a law that only some of the episodes show is found again by all ways that
exchange the others, and no effect is ever large enough. So the scale is that of balanced ways, in which what is hidden
is on both sides alike, as the residuals of a t test are orthogonal to its contrast, and what the strongest law does is
taken off before (ter Braak 1992). The scale is known from few episodes, and its uncertainty makes the tail that of
Student's t. The benchmark counts how often a chance is small where nothing is hidden ("dealt_false_alarm").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import comb, prod

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtr, chdtrc

from plop.diagnosis.evidence.contrast import Products

MOST = 2000
"""Ways that are tried at most; of more, some are drawn."""
LEAST = 1e-3
"""The smallest chance that is told: beyond it, a dozen episodes tell nothing of the tail."""
_ROUNDING = 1e-9


def ways_to_deal(here: np.ndarray, kinds: Sequence[str], least: int, seed: int = 0) -> np.ndarray:
    """List ways of dealing the episodes out, the real one first.

    Episodes change places with those of their own kind of motion, since what a base misses depends on it, where that
    leaves enough ways; else with all.

    Args:
        here: Which episodes are to be explained, bool [E].
        kinds: Kind of motion of every episode.
        least: Ways that are enough.
        seed: Draws where there are too many.

    Returns:
        Labels 0 or 1, [N, E].
    """
    groups = [np.flatnonzero(np.array(kinds) == kind) for kind in dict.fromkeys(kinds)]
    if _count(here, groups) < least:
        groups = [np.arange(len(here))]
    if _count(here, groups) <= MOST:
        found = [label for label in _all(here, groups) if (label != here).any()]
    else:
        generator, found = np.random.default_rng(seed), []
        for _ in range(MOST - 1):
            label = here.copy()
            for group in groups:
                label[group] = generator.permutation(here[group])
            found.append(label)
    return np.array([here, *found], float)


def between_repeats(here: np.ndarray, groups: Sequence[np.ndarray], ways: np.ndarray) -> np.ndarray:
    """Let episodes change places with repeats of their own motion only, where every motion was repeated.

    What the base misses is the same in these, so that they can be exchanged more nearly than others of their kind. That
    they are few does not matter to a scale.

    Args:
        here: Which episodes are to be explained, bool [E].
        groups: Episodes of one motion.
        ways: Where some motion was not repeated in the other set.

    Returns:
        Labels 0 or 1, the real ones first, [N, E].
    """
    if not all(0 < here[group].sum() < len(group) for group in groups):
        return ways
    motion = np.zeros(len(here), int)
    for k, group in enumerate(groups):
        motion[group] = k
    return ways_to_deal(here, [str(k) for k in motion], 0)


def balanced(ways: np.ndarray) -> np.ndarray:
    """Keep the ways that tell least of the real one, the first: as many of its episodes are on either side, [N, E]."""
    apart = ways - ways.mean(1, keepdims=True)
    shared = np.abs(apart @ apart[0])
    return ways[shared <= shared.min() + _ROUNDING]


def _count(here: np.ndarray, groups: Sequence[np.ndarray]) -> int:
    return prod(comb(len(group), int(here[group].sum())) for group in groups)


def _all(here: np.ndarray, groups: Sequence[np.ndarray]) -> list[np.ndarray]:
    chosen = product(*(combinations(group, int(here[group].sum())) for group in groups))
    found = []
    for parts in chosen:
        label = np.zeros(len(here), bool)
        label[[int(k) for part in parts for k in part]] = True
        found.append(label)
    return found


def strongest(products: Sequence[Products], ways: np.ndarray) -> np.ndarray:
    """Strength of the strongest hypothesis, for each way of dealing out, [N]."""
    return np.max([each.strength(ways) for each in products], axis=0)


@dataclass(frozen=True)
class ByChance:
    """What a search finds where nothing is hidden."""

    found: np.ndarray
    """Strength of the strongest law for each way of dealing out, [N]."""
    tried: int
    """Hypotheses."""
    episodes: int
    """Of recordings and reference."""

    def chance(self, strength: float, freedom: float) -> float:
        """Give the chance of a strength, of which the scale is known with some degrees of freedom.

        It is no smaller than by the noise of the model alone, were that known, for one of all hypotheses (Bonferroni):
        a strength S is reached most easily by the same gain in every episode, S^2 / H together.
        """
        if strength <= 0:
            return 1.0
        shares = freedom * (np.maximum(self.found, 0.0) / strength) ** 2
        by_noise = self.tried * float(chdtrc(1, 2 * strength**2 / self.episodes))
        return min(max(float(chdtr(freedom, shares).mean()), by_noise, LEAST), 1.0)

    def critical(self, p: float, freedom: float) -> float:
        """Give the strength that has so small a chance."""
        high = max(float(self.found.max()), 1.0)
        while self.chance(high, freedom) > p:
            high *= 2
        return float(brentq(lambda strength: self.chance(strength, freedom) - p, 0.0, high))


def chance(found: float, ways: np.ndarray) -> float:
    """Share of the ways, the real one (the first) among them, that find as much."""
    return float((1 + (ways[1:] >= found * (1 - _ROUNDING)).sum()) / len(ways))
