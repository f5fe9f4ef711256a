"""Softening with cycles: material that has been strained before resists less when strained again."""

from __future__ import annotations

# Numba infers the types of kernels; their docstrings describe the arguments.
# mypy: disallow-untyped-defs=False
import math

import numpy as np

from plop.parameters import Parameter
from plop.physics.effects.body import Body
from plop.physics.effects.effect import Effect
from plop.physics.effects.strain import add_deviator, isochoric_strain
from plop.physics.engine.jit import kernel
from plop.physics.engine.kernels.elastic import kirchhoff_stress
from plop.physics.engine.kernels.transfer import row_major

_ONE = np.float32(1)


@kernel()
def softened_stress(f, peak, law, mu, lam, loss, scale, extra):
    """Remove the share of stress that is lost below the largest strain so far.

    Takes:
        f, law, mu, lam: Deformation gradient [N, 3, 3] and the base's law, see `plop.physics.engine.kernels.elastic`.
        peak: Updated: largest I1bar - 3 so far [N].
        loss, scale: Largest share lost [-]; distance below the peak, in I1bar - 3, over which it is lost.
        extra: Added to, [N, 6] [Pa].
    """
    for p in range(f.shape[0]):
        strain, _ = isochoric_strain(f, p)
        peak[p] = max(peak[p], strain)
        share = loss * (_ONE - math.exp(-(peak[p] - strain) / scale))
        add_deviator(extra, p, -share, *kirchhoff_stress(law, *row_major(f, p), mu, lam))


class Softening(Effect):
    """A Mullins effect: below the largest strain so far the deviatoric stress is smaller than on first loading.

    Loss sets in over `strain`: after a uniaxial strain much larger than that, the stress on reloading is
    (1 - loss) times the first one. First loading is not changed.
    """

    name = "softening"
    help = "material that was strained before resists less the second time"
    law = "dev(tau) -> (1 - loss (1 - exp(-(peak - w) / (3 strain^2)))) dev(tau), w = I1bar - 3, peak = max w so far"
    source = "Ogden & Roxburgh 1999, A pseudo-elastic model for the Mullins effect in filled rubber, with exp for erf"
    amplitudes = (
        Parameter("loss", "-", 0.0, 0.95, step=0.1, typical=0.9, help="largest share of stress that is lost"),
    )
    shapes = (
        Parameter("strain", "-", 0.001, 1.0, step=0.0, default=0.02, help="uniaxial strain that counts as large"),
    )
    variants = ({"strain": 0.02},)
    remembers = {"peak": ((), 0.0)}

    def stress(self, body: Body, dt: float) -> None:
        """Reduce the base's deviatoric stress."""
        loss, scale = np.float32(self["loss"]), np.float32(3 * self["strain"] ** 2)
        softened_stress(body.f, body.memory["softening.peak"], *body.elastic, loss, scale, body.extra)
