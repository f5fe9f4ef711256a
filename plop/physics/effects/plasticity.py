"""Plasticity: beyond a yield stress the material flows and keeps its new shape."""

from __future__ import annotations

# Numba infers the types of kernels; their docstrings describe the arguments.
# mypy: disallow-untyped-defs=False
import math

import numpy as np
from numba import njit

from plop.parameters import Parameter
from plop.physics.effects.body import Body
from plop.physics.effects.effect import Effect
from plop.physics.effects.strain import eigen_symmetric, left_cauchy_green
from plop.physics.engine.jit import kernel
from plop.physics.engine.kernels.elastic import kirchhoff_stress
from plop.physics.engine.kernels.transfer import row_major

_ZERO = np.float32(0)
_ONE = np.float32(1)
_THIRD = np.float32(1 / 3)
_TWO_THIRDS = np.float32(2 / 3)
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
def admissible_share(law, mu, lam, mean, x, y, z, limit_pa, slope_pa, trial_pa):
    """The share s of the deviatoric logarithmic strain (x, y, z) at which the base's stress is at the limit.

    The limit is limit_pa + slope_pa (1 - s). The stress is nearly linear in s: four iterations of Newton's
    method reach float32 precision.
    """
    share, stress = _ONE, trial_pa
    for _ in range(_ROUNDS):
        above = stress - limit_pa - slope_pa * (_ONE - share)
        share -= above / (stress / share + slope_pa)
        share = min(max(share, _SMALLEST), _ONE)
        p, q, r = math.exp(mean + share * x), math.exp(mean + share * y), math.exp(mean + share * z)
        stress = von_mises(*kirchhoff_stress(law, p, _ZERO, _ZERO, _ZERO, q, _ZERO, _ZERO, _ZERO, r, mu, lam))
    return share


@kernel()
def yield_flow(f, flow, law, mu, lam, yield_pa, hardening_pa):
    """Reduce the elastic strain of every particle until its von Mises stress does not exceed the yield stress.

    Takes:
        f: Elastic deformation gradient, updated, [N, 3, 3]; its volume and its rotation are kept.
        flow: Updated: equivalent plastic strain so far [N].
        law, mu, lam: The base's law, see `plop.physics.engine.kernels.elastic`.
        yield_pa, hardening_pa: First yield stress; its growth with the plastic strain [Pa].
    """
    a, v, g = np.empty((3, 3), np.float32), np.empty((3, 3), np.float32), np.empty((3, 3), np.float32)
    for p in range(f.shape[0]):
        trial = von_mises(*kirchhoff_stress(law, *row_major(f, p), mu, lam))
        limit = yield_pa + hardening_pa * flow[p]
        if trial <= limit:
            continue
        eigen_symmetric(*left_cauchy_green(f, p), a, v)
        x, y = _HALF * math.log(max(a[0, 0], _SMALLEST)), _HALF * math.log(max(a[1, 1], _SMALLEST))
        z = _HALF * math.log(max(a[2, 2], _SMALLEST))
        mean = (x + y + z) * _THIRD
        x, y, z = x - mean, y - mean, z - mean
        size = math.sqrt(_TWO_THIRDS * (x * x + y * y + z * z))
        less = admissible_share(law, mu, lam, mean, x, y, z, limit, hardening_pa * size, trial) - _ONE
        flow[p] -= less * size
        p0, p1, p2 = math.exp(less * x), math.exp(less * y), math.exp(less * z)
        for i in range(3):
            for j in range(3):
                g[i, j] = v[i, 0] * p0 * v[j, 0] + v[i, 1] * p1 * v[j, 1] + v[i, 2] * p2 * v[j, 2]
        for k in range(3):
            f0, f1, f2 = f[p, 0, k], f[p, 1, k], f[p, 2, k]
            for i in range(3):
                f[p, i, k] = g[i, 0] * f0 + g[i, 1] * f1 + g[i, 2] * f2


class Plasticity(Effect):
    """Plasticity after von Mises with linear hardening; the engine's `f` is the elastic part F_e of F = F_e F_p.

    The yield stress is 1 / softness, so that 0 means 'never yields'. The criterion uses the base's Kirchhoff
    stress. There is no response until the largest stress of a motion reaches the yield stress: the response
    has a threshold. Without hardening the flow would localise in a layer one cell thick.
    """

    name = "plasticity"
    help = "beyond a yield stress it flows and keeps its new shape"
    law = "sqrt(3/2) |dev(tau)| <= 1 / softness + 3 mu hardening e_p, by reducing the elastic strain by the flow e_p"
    source = "von Mises 1913; return mapping: Simo & Hughes, Computational Inelasticity, 1998, ch. 9"
    amplitudes = (
        Parameter(
            "softness_per_kpa", "1/kPa", 0.0, 20.0, step=2.0, typical=4.0, help="1 / yield stress", tried=(2.0, 8.0)
        ),
    )
    shapes = (
        Parameter("hardening", "-", 0.0, 1.0, step=0.0, default=0.1, help="slope of stress over flow, over 3 mu"),
    )
    remembers = {"flow": ((), 0.0)}

    @property
    def yield_pa(self) -> float:
        """First yield stress [Pa]."""
        return 1e3 / self["softness_per_kpa"] if self["softness_per_kpa"] else np.inf

    def after(self, body: Body, dt: float) -> None:
        """Flow."""
        hardening_pa = 3 * self["hardening"] * body.material.shear_pa
        yield_flow(
            body.f, body.memory["plasticity.flow"], *body.elastic, np.float32(self.yield_pa), np.float32(hardening_pa)
        )
