"""Air drag, a decoy: fast motion is resisted."""

from __future__ import annotations

import numpy as np

from plop.parameters import Parameter
from plop.physics.effects.body import Body
from plop.physics.effects.effect import Effect


class Drag(Effect):
    """Drag that grows with the square of the speed, spread over the body.

    A body of density rho, frontal area A and volume V in air of density rho_air has
    c = rho_air C_d A / (2 rho V): about 0.007 1/m for a block of jelly that fits into a hand.
    A linear law would be the base's own damping.
    """

    name = "drag"
    kind = "decoy"
    help = "air drag: fast motion is resisted"
    law = "v' += -c |v| v"
    source = "Rayleigh's drag equation; Batchelor, An Introduction to Fluid Dynamics, 1967, ch. 5"
    acts_at_rest = False
    amplitudes = (Parameter("per_m", "1/m", 0.0, 1e3, step=20.0, typical=200.0, help="drag coefficient c"),)

    def before(self, body: Body, dt: float) -> None:
        """Slow down; exact for a free body, v / (1 + c |v| dt), so that it is stable for any step."""
        speed = np.sqrt(np.einsum("ni,ni->n", body.v, body.v))
        body.v /= (1 + np.float32(self["per_m"] * dt) * speed)[:, None]
