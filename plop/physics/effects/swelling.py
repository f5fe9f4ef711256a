"""Swelling and shrinkage: the stress-free volume changes with time."""

from __future__ import annotations

import numpy as np

from plop.parameters import Parameter
from plop.physics.effects.body import Body
from plop.physics.effects.effect import Effect


class Swelling(Effect):
    """Multiplicative growth F = F_e F_g with F_g = exp(rate t / 3) I; the engine's `f` is the elastic part F_e.

    A free body's volume grows as exp(rate t), its lengths as exp(rate t / 3). Mass is constant; stress is
    per original volume, which for growth by some per cent changes forces by as many per cent.
    """

    name = "swelling"
    help = "the material swells or, with a negative rate, shrinks"
    law = "F_e' = L F_e - (rate / 3) F_e"
    source = "Rodriguez, Hoger & McCulloch 1994, Stress-dependent finite growth in soft elastic tissues"
    acts_at_rest = False
    amplitudes = (
        Parameter("rate_per_s", "1/s", -1.0, 1.0, step=0.01, typical=-0.1, help="relative change of volume per second"),
    )

    def after(self, body: Body, dt: float) -> None:
        """Grow."""
        body.f *= np.float32(np.exp(-self["rate_per_s"] * dt / 3))
