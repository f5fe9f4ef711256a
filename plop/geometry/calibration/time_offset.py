"""Time offset between two clocks, from a motion that both have seen."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def offset_by_search(
    cost: Callable[[float], float], *, max_offset_s: float, step_s: float
) -> tuple[float, float] | None:
    """Find the offset that minimises a cost, coarse to fine.

    Args:
        cost: Disagreement at one offset [s]; NaN where it cannot be told.
        max_offset_s: Largest offset searched [s].
        step_s: Spacing of the first search [s]; refined to a tenth of it.

    Returns:
        Offset [s] and how much worse (as a factor, >= 1) the cost is one `step_s` away;
        None when the minimum lies at the border or the cost does not depend on the offset.
    """
    count = int(np.ceil(max_offset_s / step_s))
    offsets = step_s * np.arange(-count, count + 1)
    values = np.array([cost(float(offset)) for offset in offsets])
    if not np.isfinite(values).any():
        return None
    best = int(np.nanargmin(values))
    if best in (0, len(values) - 1):
        return None
    fine = offsets[best] + step_s * np.linspace(-1, 1, 21)
    fine_values = np.array([cost(float(offset)) for offset in fine])
    near = int(np.nanargmin(fine_values))
    ties = np.flatnonzero(fine_values <= fine_values[near] * (1 + 1e-9))
    found = float(fine[ties].mean())
    around = np.array([cost(found - step_s), cost(found + step_s)])
    contrast = float(np.nanmin(around) / max(fine_values[near], 1e-12)) if np.isfinite(around).any() else 1.0
    return found, contrast
