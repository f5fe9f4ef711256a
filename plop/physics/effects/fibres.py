"""Fibres: the material is stiffer along one horizontal direction."""

from __future__ import annotations

# Numba infers the types of kernels; their docstrings describe the arguments.
# mypy: disallow-untyped-defs=False
import numpy as np

from plop.parameters import Parameter
from plop.physics.effects.body import Body
from plop.physics.effects.effect import Effect
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.jit import kernel
from plop.physics.engine.material import Material
from plop.physics.engine.time_step import wave_step_s

_ONE = np.float32(1)


@kernel()
def fibre_stress(f, cos, sin, half_pa, extra):
    """Add half_pa (I4 - 1) a a^T with a = F (cos, sin, 0).

    Takes:
        f, cos, sin, half_pa: Deformation gradient [N, 3, 3], direction at rest, half the added modulus [Pa].
        extra: Added to, [N, 6] [Pa].
    """
    for p in range(f.shape[0]):
        x = f[p, 0, 0] * cos + f[p, 0, 1] * sin
        y = f[p, 1, 0] * cos + f[p, 1, 1] * sin
        z = f[p, 2, 0] * cos + f[p, 2, 1] * sin
        pull = half_pa * (x * x + y * y + z * z - _ONE)
        extra[p, 0] += pull * x * x
        extra[p, 1] += pull * y * y
        extra[p, 2] += pull * z * z
        extra[p, 3] += pull * x * y
        extra[p, 4] += pull * x * z
        extra[p, 5] += pull * y * z


class Fibres(Effect):
    """One family of fibres, W = ratio E / 8 (I4 - 1)^2, that resist stretching and compression equally.

    At small strain a bar along the fibres has the modulus (1 + ratio) E. Directions are those of the material
    where F is the identity.
    """

    name = "fibres"
    help = "stiffer along one horizontal direction"
    law = "tau += ratio E / 2 (I4 - 1) a a^T, a = F a0, I4 = |a|^2"
    source = "standard reinforcing model: Merodio & Ogden 2003, Int. J. Solids and Structures 40, 4707"
    amplitudes = (
        Parameter("ratio", "-", 0.0, 50.0, step=0.1, typical=3.0, help="added stiffness along the fibres over E"),
    )
    shapes = (Parameter("angle_deg", "deg", -180.0, 180.0, step=0.0, help="direction, from x towards y"),)
    variants = tuple({"angle_deg": angle} for angle in (0.0, 45.0, 90.0, 135.0))

    def stress(self, body: Body, dt: float) -> None:
        """Pull along the fibres."""
        angle = np.deg2rad(self["angle_deg"])
        half_pa = self["ratio"] * body.material.youngs_modulus_pa / 2
        fibre_stress(body.f, np.float32(np.cos(angle)), np.float32(np.sin(angle)), np.float32(half_pa), body.extra)

    def slowest_step_s(self, material: Material, config: EngineConfig) -> float:
        """Waves run faster along the fibres, the more so when these are stretched."""
        return wave_step_s(1.5 * self["ratio"] * material.youngs_modulus_pa, material, config)
