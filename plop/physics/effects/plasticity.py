"""Plasticity: beyond a yield stress the material flows and keeps its new shape."""

from __future__ import annotations

# Numba infers the types of kernels; their docstrings say what they take.
# mypy: disallow-untyped-defs=False
import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from plop.physics.effects.effect import Effect, Parameter
from plop.physics.effects.strain import eigen_symmetric, left_cauchy_green
from plop.physics.elastic import kirchhoff_stress
from plop.physics.jit import kernel
from plop.physics.transfer import row_major

if TYPE_CHECKING:
    from plop.physics.engine import Engine

_ZERO = np.float32(0)
_ONE = np.float32(1)
_THIRD = np.float32(1 / 3)
_HALF = np.float32(0.5)
_SMALLEST = np.float32(1e-6)
_ROUNDS = 4


@njit(fastmath=True)
def von_mises(xx, yy, zz, xy, xz, yz):
    """Von Mises' equivalent stress sqrt(3/2 dev : dev) of a symmetric matrix."""
    a, b, c = xx - yy, yy - zz, zz - xx
    shear = xy * xy + xz * xz + yz * yz
    return math.sqrt(_HALF * (a * a + b * b + c * c) + np.float32(3) * shear)


@njit(fastmath=True)
def admissible_share(law, mu, lam, mean, x, y, z, yield_pa, trial_pa):
    """The share of the deviatoric logarithmic strain (x, y, z) that the base's law can carry at the yield stress.

    The stress is nearly linear in that share: four rounds of scaling reach float32 precision.
    """
    share, stress = _ONE, trial_pa
    for _ in range(_ROUNDS):
        share *= yield_pa / stress
        p, q, r = math.exp(mean + share * x), math.exp(mean + share * y), math.exp(mean + share * z)
        stress = von_mises(*kirchhoff_stress(law, p, _ZERO, _ZERO, _ZERO, q, _ZERO, _ZERO, _ZERO, r, mu, lam))
    return share


@kernel()
def yield_flow(f, law, mu, lam, yield_pa):
    """Shrink the elastic strain of every particle until its von Mises stress is not above `yield_pa`.

    Takes:
        f: Elastic deformation gradient, updated, [N, 3, 3]; its volume and its rotation are kept.
        law, mu, lam: The base's law, see `plop.physics.elastic`.
        yield_pa: Yield stress [Pa].
    """
    a, v, g = np.empty((3, 3), np.float32), np.empty((3, 3), np.float32), np.empty((3, 3), np.float32)
    for p in range(f.shape[0]):
        trial = von_mises(*kirchhoff_stress(law, *row_major(f, p), mu, lam))
        if trial <= yield_pa:
            continue
        eigen_symmetric(*left_cauchy_green(f, p), a, v)
        x, y = _HALF * math.log(max(a[0, 0], _SMALLEST)), _HALF * math.log(max(a[1, 1], _SMALLEST))
        z = _HALF * math.log(max(a[2, 2], _SMALLEST))
        mean = (x + y + z) * _THIRD
        x, y, z = x - mean, y - mean, z - mean
        less = admissible_share(law, mu, lam, mean, x, y, z, yield_pa, trial) - _ONE
        p0, p1, p2 = math.exp(less * x), math.exp(less * y), math.exp(less * z)
        for i in range(3):
            for j in range(3):
                g[i, j] = v[i, 0] * p0 * v[j, 0] + v[i, 1] * p1 * v[j, 1] + v[i, 2] * p2 * v[j, 2]
        for k in range(3):
            f0, f1, f2 = f[p, 0, k], f[p, 1, k], f[p, 2, k]
            for i in range(3):
                f[p, i, k] = g[i, 0] * f0 + g[i, 1] * f1 + g[i, 2] * f2


class Plasticity(Effect):
    """Perfect plasticity after von Mises; the engine's `f` is the elastic part F_e of F = F_e F_p.

    The yield stress is 1 / softness, so that 0 means 'never yields'. The stress judged is the base's Kirchhoff
    stress. Nothing happens until the largest stress of a motion reaches the yield stress: the response
    starts at a threshold.
    """

    name = "plasticity"
    help = "beyond a yield stress it flows and keeps its new shape"
    law = "sqrt(3/2) |dev(tau)| <= 1 / softness, by shrinking the deviatoric logarithmic elastic strain"
    source = "von Mises 1913; return mapping: Simo & Hughes, Computational Inelasticity, 1998, ch. 9"
    amplitudes = (Parameter("softness_per_kpa", "1/kPa", 0.0, 20.0, step=0.2, typical=0.5, help="1 / yield stress"),)

    @property
    def yield_pa(self) -> float:
        """Yield stress [Pa]."""
        return 1e3 / self["softness_per_kpa"] if self["softness_per_kpa"] else np.inf

    def after(self, body: Engine, dt: float) -> None:
        """Flow."""
        yield_flow(body.f, *body.elastic, np.float32(self.yield_pa))
