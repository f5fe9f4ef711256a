"""Effects that a user wants to hide: EFFECT=AMPLITUDE, EFFECT.PARAMETER=VALUE, EFFECT, or random."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plop.errors import PlopError
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType, effect_type

RANDOM = "random"
"""The word for a randomly drawn effect."""


@dataclass(frozen=True)
class Wish:
    """One effect to hide."""

    effect: EffectType | None
    """The effect's class; None: to be drawn."""
    values: dict[str, float]
    """Parameters that were given."""

    def scaled(self, factor: float) -> Effect:
        """Return the effect with its amplitudes multiplied.

        Raises:
            PlopError: An amplitude leaves its range.
        """
        assert self.effect is not None
        ends = {p.name: (p.low, p.high) for p in self.effect.amplitudes}
        values = {key: value * factor if key in ends else value for key, value in self._start().items()}
        if factor == self.most():  # rounding must not leave the range
            values |= {key: float(np.clip(value, *ends[key])) for key, value in values.items() if key in ends}
        return self.effect(**values)

    def most(self) -> float:
        """Return the largest factor at which all amplitudes stay in their ranges."""
        assert self.effect is not None
        start, limits = self._start(), [np.inf]
        for p in self.effect.amplitudes:
            value = start.get(p.name, 0.0)
            limits += [(p.high if value > 0 else p.low) / value] if value else []
        return float(min(limits))

    def _start(self) -> dict[str, float]:
        """Values at factor 1: as given, or typical ones when no amplitude was given."""
        assert self.effect is not None
        given = {p.name for p in self.effect.amplitudes} & self.values.keys()
        return self.values if given else typical(self.effect) | self.values


def parse_hidden(texts: Sequence[str], effects: dict[str, EffectType] | None = None) -> list[Wish]:
    """Read `EFFECT=AMPLITUDE`, `EFFECT.PARAMETER=VALUE`, `EFFECT` alone, or `random`.

    Several texts about one effect are merged; `random` may be repeated.

    Args:
        texts: The arguments of the user.
        effects: All effects; None uses the built-in ones.

    Raises:
        PlopError: An unknown effect or parameter, not a number, or a value out of range.
    """
    drawn, named = [Wish(None, {}) for text in texts if text.strip() == RANDOM], dict[str, Wish]()
    for text in (text.strip() for text in texts if text.strip() != RANDOM):
        left, equals, number = text.partition("=")
        name, _, parameter = left.strip().partition(".")
        effect = effect_type(name, effects)
        wish = named.setdefault(name, Wish(effect, {}))
        if not equals:
            continue
        try:
            wish.values[parameter or effect.amplitudes[0].name] = float(number)
        except ValueError:
            raise PlopError(
                "The hidden effect is not valid.",
                where=text,
                found=repr(number),
                expected="EFFECT=AMPLITUDE or EFFECT.PARAMETER=VALUE with a number",
                fix=f"For example {name}={effect.amplitudes[0].typical:g}.",
            ) from None
    for wish in named.values():
        wish.scaled(1.0)
    return [*named.values(), *drawn]


def typical(effect: EffectType) -> dict[str, float]:
    """Return the typical amplitudes of an effect."""
    return {p.name: p.typical or p.step for p in effect.amplitudes}
