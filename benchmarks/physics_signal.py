"""Scale what is hidden until it moves the object by a wanted multiple of the noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from plop.errors import PlopError
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType

TRIALS = 5
CLOSE = 1.1
"""A signal within this factor of the wanted one is good enough."""
_LARGEST_STEP = 6.0


def scaled(kind: EffectType, values: Mapping[str, float], factor: float) -> Effect:
    """Build an effect with its amplitudes multiplied, as far as their ranges go."""
    own = [p for p in kind.amplitudes if p.name in values]
    return kind(**{**values, **{p.name: float(np.clip(factor * values[p.name], p.low, p.high)) for p in own}})


def at_signal(
    kind: EffectType, values: Mapping[str, float], wanted: float, signal: Callable[[Effect], float]
) -> tuple[Effect, float]:
    """Find the amplitude with a wanted signal; direction and shape stay.

    The signal grows with a power of the amplitude; the exponent is that of the last two trials. An amplitude at
    which the simulation is unstable halves the step.

    Args:
        kind: The effect.
        values: Its parameters where the search starts.
        wanted: Signal wanted [-].
        signal: Measures the signal [-]; raises PlopError where the simulation is unstable.

    Returns:
        The effect whose signal is nearest, and that signal: smaller than wanted where the range ends before.
    """
    tried: list[tuple[float, float, Effect]] = []
    factor = 1.0
    for _ in range(TRIALS):
        effect = scaled(kind, values, factor)
        if any(t[2].values == effect.values for t in tried):  # the range ends here
            break
        try:
            found = signal(effect)
        except PlopError:
            factor = factor / 2 if not tried else float(np.sqrt(factor * tried[-1][0]))
            continue
        tried.append((factor, found, effect))
        if wanted / CLOSE <= found <= wanted * CLOSE:
            break
        factor = _next(tried, wanted)
    if not tried:
        raise PlopError("No amplitude could be simulated.", where=kind.name)
    _, found, effect = min(tried, key=lambda t: abs(np.log(max(t[1], 1e-9) / wanted)))
    return effect, found


def _next(tried: list[tuple[float, float, Effect]], wanted: float) -> float:
    factor, found, _ = tried[-1]
    exponent = 1.0
    if len(tried) > 1:
        rise = np.log(max(found, 1e-9) / max(tried[-2][1], 1e-9)) / np.log(factor / tried[-2][0])
        exponent = float(np.clip(rise, 0.3, 2.0))
    step = (wanted / max(found, 1e-9)) ** (1 / exponent)
    return factor * float(np.clip(step, 1 / _LARGEST_STEP, _LARGEST_STEP))
