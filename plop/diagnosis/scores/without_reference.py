"""Without reference recordings: how strongly a law seems to be missing where nothing is hidden, as engines differ.

What an engine misses by itself looks like a law, too, and without a reference nothing in the recordings says which it
is. What can be said rests on recordings of other objects, simulated by other engines, in which nothing is hidden: the
strength of the best law there is log-normal, and a new one is judged by its predictive distribution (Student's t).
"""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

STRENGTHS = {
    "DiSECt, cuts of a jelly prism": (45.0, 39.0),
    "MuJoCo, presses, pushes and drags of a tapered block": (23.0, 22.0),
    "own engine, finer and of another elastic law": (10.0, 6.0, 4.0),
}
"""Strength of the best law where nothing is hidden, by world; one number a set of six episodes."""


def chance_without_reference(strength: float) -> float:
    """Chance that some law of the library seems as strong where nothing is hidden."""
    known = np.log1p(np.concatenate([np.array(values) for values in STRENGTHS.values()]))
    count = len(known)
    error = float(known.std(ddof=1)) * np.sqrt(1 + 1 / count)
    return float(student.sf((np.log1p(max(strength, 0.0)) - known.mean()) / error, count - 1))
