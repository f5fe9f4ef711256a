"""How often a search finds as much where nothing is hidden: the whole search, on the same episodes dealt out anew.

If nothing is hidden, recordings and reference are alike but for their motions, and any of the ways of dealing the
episodes out into two such sets might have been the real one (Fisher 1935; Pitman 1937). Each way is searched as the
real one is, over all laws and amplitudes, and the share of ways that find as much is the chance of a false alarm:
whatever the base misses, however it errs, and however many hypotheses are tried (Westfall & Young 1993). No other
number in a diagnosis is called a chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product
from math import comb, prod

import numpy as np

from plop.diagnosis.contrast import Products

MOST = 2000
"""Ways that are tried at most; of more, some are drawn."""
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


def chance(found: float, ways: np.ndarray) -> float:
    """Share of the ways, the real one (the first) among them, that find as much."""
    return float((1 + (ways[1:] >= found * (1 - _ROUNDING)).sum()) / len(ways))
