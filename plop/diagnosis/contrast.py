"""Does an effect have another amplitude here than in the reference recordings, where nothing is missing?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from plop.diagnosis.regression import Fit

P_LARGEST = 0.02
"""Family-wise chance of a false alarm up to which an effect is named."""


@dataclass(frozen=True)
class Contrast:
    """An amplitude against that in the reference (Welch's test: episodes are what counts as independent)."""

    errors: float
    """Distance in standard errors."""
    p: float
    """Chance of such a distance for any effect of the library when none has changed."""
    least: float
    """Smallest change of the first amplitude that would be clear."""


def contrast_of(here: Fit, reference: Fit, own: int, family: int) -> Contrast:
    """Compare the last `own` amplitudes of two fits of the same columns.

    Few episodes make their own scatter uncertain: the degrees of freedom are Welch's (Biometrika 34, 1947), and p is
    multiplied by the number of hypotheses (Bonferroni).

    Args:
        here: Fit to the episodes to explain.
        reference: Fit to the reference.
        own: Number of amplitudes to compare, the last ones.
        family: Hypotheses among which the best is looked for.
    """
    parts = here.spread[-own:, -own:], reference.spread[-own:, -own:]
    spread = parts[0] + parts[1]
    difference = here.values[-own:] - reference.values[-own:]
    squared = float(difference @ np.linalg.pinv(spread) @ difference / own)
    freedom = [
        np.diag(part) ** 2 / max(fit.episodes - 1, 1) for part, fit in zip(parts, (here, reference), strict=True)
    ]
    degrees = float((np.diag(spread) ** 2 / np.maximum(freedom[0] + freedom[1], 1e-300)).min())
    degrees = max(degrees, 1.0)
    p = min(1.0, family * float(fisher.sf(squared, own, degrees)))
    least = float(student.isf(P_LARGEST / (2 * family), degrees) * np.sqrt(spread[0, 0]))
    return Contrast(float(np.sqrt(squared)), p, least)
