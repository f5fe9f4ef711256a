"""Strain stiffening: the more it is deformed, the stiffer the material."""

from __future__ import annotations

# Numba infers the types of kernels; their docstrings describe the arguments.
# mypy: disallow-untyped-defs=False
import numpy as np

from plop.parameters import Parameter
from plop.physics.effects.body import Body
from plop.physics.effects.effect import Effect
from plop.physics.effects.strain import add_deviator, isochoric_strain, left_cauchy_green
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.jit import kernel
from plop.physics.engine.material import Material
from plop.physics.engine.time_step import wave_step_s


@kernel()
def stiffening_stress(f, factor_pa, extra):
    """Add factor_pa (I1bar - 3) dev(bbar).

    Takes:
        f, factor_pa: Deformation gradient [N, 3, 3]; shear modulus times amplitude [Pa].
        extra: Added to, [N, 6] [Pa].
    """
    for p in range(f.shape[0]):
        strain, scale = isochoric_strain(f, p)
        add_deviator(extra, p, factor_pa * strain * scale, *left_cauchy_green(f, p))


class Stiffening(Effect):
    """Yeoh's second term, W = mu growth / 4 (I1bar - 3)^2, beside the base's law: a stress cubic in the strain."""

    name = "stiffening"
    help = "the more it is deformed, the stiffer it gets"
    law = "tau += mu growth (I1bar - 3) dev(bbar), bbar = J^(-2/3) F F^T, I1bar = tr(bbar)"
    source = "Yeoh 1993, Some forms of the strain energy function for rubber"
    amplitudes = (
        Parameter("growth", "-", 0.0, 500.0, step=5.0, typical=100.0, help="growth of the modulus with I1bar - 3"),
    )

    def stress(self, body: Body, dt: float) -> None:
        """Add the cubic term."""
        stiffening_stress(body.f, np.float32(self["growth"] * body.material.shear_pa), body.extra)

    def slowest_step_s(self, material: Material, config: EngineConfig) -> float:
        """Use the wave speed at a stretch of 1.2, where I1bar - 3 is about 0.1; beyond it the step is halved."""
        return wave_step_s(0.4 * self["growth"] * material.shear_pa, material, config)
