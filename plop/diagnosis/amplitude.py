"""How well an amplitude is known: what differs between episodes, what the engine gets wrong, what saturation hides.

All amplitudes belong to its interval whose response is as large as the fitted one's, give or take what episodes
differ by and what the engine gets wrong. A law whose response hardly grows any more leaves its amplitude open. Where a
response grows steeply (a bond that holds or does not) its size alone would tell the amplitude to a few per cent; but
the engine may be as wrong about how strong a law must be to do the same, so that an interval is never narrower than
for a response that is proportional.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from plop.diagnosis.candidates import Column
from plop.diagnosis.profile import Profile
from plop.parameters import Estimate
from plop.statistics.cluster_robust import Clusters

RESPONSE_ERROR = 0.25
"""Standard deviation of how much too strongly or too weakly the engine responds to a law [-], and of how much too
strong or too weak a law must be for it to respond so: the same in all episodes, so that no scatter between them tells.
A round figure from runs where the truth is known, which docs/results/parts.md gives."""
STRONGEST_RESPONSE = 1 + float(norm.ppf(0.975)) * RESPONSE_ERROR
"""How much stronger than the engine's a response may be, at most, for an amplitude to count as inside its range."""


def amplitude_of(
    column: Column, value: float, error: float, freedom: float, profile: Profile | None = None
) -> Estimate:
    """Give a fitted amplitude with its 95 % interval, kept inside the range of the parameter.

    Args:
        column: What was fitted.
        value: Fitted amplitude.
        error: Its standard error over episodes.
        freedom: Degrees of freedom with which that is known.
        profile: Response over amplitude; proportional when absent.

    Returns:
        An amplitude that cannot be told has an infinite interval.
    """
    at_bound = value >= column.high or value <= column.low and column.low != 0
    by_chance = student.ppf(0.975, max(freedom, 1.0)) * error
    if value == 0 or not np.isfinite(by_chance):
        low, high = value - by_chance, value + by_chance
    else:
        wrong = norm.ppf(0.975) * RESPONSE_ERROR
        width = float(np.hypot(by_chance / abs(value), wrong))
        ends = [_at(value, factor, profile) for factor in (1 - width, 1 + width)]
        ends += [value * (1 - wrong), value * (1 + wrong)]
        low, high = (float(np.clip(end, column.low, column.high)) for end in (min(ends), max(ends)))
    inside = float(np.clip(value, column.low, column.high))
    return Estimate(inside, float(low), float(high), column.unit, bool(at_bound or value < column.low))


def _at(value: float, factor: float, profile: Profile | None) -> float:
    """Amplitude whose response is `factor` times that of `value`."""
    # beyond a whole response there is no saturation to speak of: the law may as well have the other sign
    if profile is None or factor <= 0 or value * profile.amplitudes[-1] <= 0:
        return value * factor
    return profile.at_response(value, factor)


def parameters_of(
    columns: tuple[Column, ...], fitted: Clusters, profiles: Mapping[str, Profile], alone: bool = True
) -> dict[str, Estimate]:
    """Give the last values with their intervals; a law alone has the amplitude of its least error where it is known."""
    (variances, freedom), own = fitted.steadied(), slice(-len(columns), None)
    errors, found = np.sqrt(variances), {}
    for column, value, error, degrees in zip(columns, fitted.values[own], errors[own], freedom[own], strict=True):
        profile = profiles.get(column.key)
        amplitude = profile.least() if alone and profile is not None else float(value)
        found[column.amplitude] = amplitude_of(column, amplitude, float(error), float(degrees), profile)
    return found
