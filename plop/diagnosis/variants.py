"""Settings of one law, a time constant or a direction, that these recordings cannot tell apart.

A law is tried with a few settings of its shape, and the one that explains most is taken. Which one that is, is partly
chance; and an amplitude belongs to its setting: a bond that lets go sooner must be stronger to do the same. What the
amplitude is in every setting that does as well therefore belongs to its interval.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.stats import t as student

from plop.diagnosis.screen import Score, worse_than

CHANCE = 0.05
"""Chance with which a setting that is as good would be left out."""
_ROUNDING = 1e-9
"""Share of the error that is left below which a difference is one of arithmetic."""


def others_of(best: Collection[str], scores: Sequence[Score]) -> dict[str, np.ndarray]:
    """Give the fitted amplitudes of the other settings of some laws, by candidate.

    Args:
        best: Keys of the candidates whose laws are meant.
        scores: Of all candidates.
    """
    laws = {score.candidate.effect for score in scores if score.candidate.key in best}
    return {
        score.candidate.key: score.values
        for score in scores
        if score.candidate.effect in laws and score.candidate.key not in best
    }


def as_good(best: Score, scores: Sequence[Score]) -> list[Score]:
    """Find the settings of the same law that leave no more of the held-out error, but for chance between episodes.

    Args:
        best: The setting that is taken.
        scores: Those that may be as good; other laws, and the best itself, are passed over.
    """
    found = []
    for score in scores:
        if score.candidate.effect != best.candidate.effect or score.candidate.key == best.candidate.key:
            continue
        worse, error = worse_than(best, score)
        if worse <= student.ppf(1 - CHANCE, len(best.after) - 1) * error + _ROUNDING * best.after.sum():
            found.append(score)
    return found
