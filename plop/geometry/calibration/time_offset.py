"""Time offset between two clocks, from a motion that both have seen."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plop.errors import PlopError


def offset_by_correlation(
    time_a_s: np.ndarray,
    signal_a: np.ndarray,
    time_b_s: np.ndarray,
    signal_b: np.ndarray,
    *,
    max_offset_s: float = 0.5,
    step_s: float = 1e-3,
) -> tuple[float, float]:
    """Find how much later signal a shows the same motion than signal b.

    Both are resampled by linear interpolation; the offset maximises the normalised cross-correlation,
    refined between steps by a parabola.

    Args:
        time_a_s: Shape [N], increasing [s]. E.g. image times.
        signal_a: Shape [N], e.g. speed of the image motion; any unit.
        time_b_s: Shape [M], increasing [s]. E.g. robot times.
        signal_b: Shape [M], e.g. speed of the flange; any unit.
        max_offset_s: Largest offset searched [s].
        step_s: Spacing of the offsets tried [s].

    Returns:
        Offset [s] such that signal_a(t + offset) matches signal_b(t), and the correlation there, -1 to 1.

    Raises:
        PlopError: Lengths do not match, values are not finite, there is no motion, or the times do not overlap.
    """
    for what, time, signal in (("a", time_a_s, signal_a), ("b", time_b_s, signal_b)):
        if len(time) != len(signal) or len(time) < 8:
            raise PlopError(
                "Two signals cannot be aligned.",
                where=f"signal {what}",
                expected="as many values as times, at least 8",
                found=f"{len(signal)} values, {len(time)} times",
            )
        if not (np.isfinite(time).all() and np.isfinite(signal).all()) or (np.diff(time) <= 0).any():
            raise PlopError(
                "A signal is not usable.", where=f"signal {what}", expected="finite values at increasing times"
            )
        if np.std(signal) < 1e-12:
            raise PlopError(
                "There is no motion to align.",
                where=f"signal {what}",
                expected="a changing signal",
                found="a constant",
                fix="Record a motion with starts and stops.",
            )
    offsets = np.arange(-max_offset_s, max_offset_s + step_s / 2, step_s)
    scores = np.array([_correlation(time_a_s - o, signal_a, time_b_s, signal_b) for o in offsets])
    if not np.isfinite(scores).any():
        raise PlopError(
            "The two signals do not overlap in time.",
            expected="a common span of at least 8 samples",
            found=f"a: {time_a_s[0]:.3f}..{time_a_s[-1]:.3f} s, b: {time_b_s[0]:.3f}..{time_b_s[-1]:.3f} s",
        )
    best = int(np.nanargmax(scores))
    return float(offsets[best] + step_s * _vertex(-scores, best)), float(scores[best])


def _correlation(time_a: np.ndarray, a: np.ndarray, time_b: np.ndarray, b: np.ndarray) -> float:
    inside = (time_b >= time_a[0]) & (time_b <= time_a[-1])
    if inside.sum() < 8:
        return float("nan")
    x, y = np.interp(time_b[inside], time_a, a), b[inside]
    x, y = x - x.mean(), y - y.mean()
    size = np.linalg.norm(x) * np.linalg.norm(y)
    return float(x @ y / size) if size > 0 else float("nan")


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


def _vertex(values: np.ndarray, index: int) -> float:
    """Place the minimum of the parabola through three neighbouring values, -0.5 to 0.5 of a step."""
    if index in (0, len(values) - 1):
        return 0.0
    left, middle, right = values[index - 1 : index + 2]
    bend = left - 2 * middle + right
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend > 0 else 0.0
