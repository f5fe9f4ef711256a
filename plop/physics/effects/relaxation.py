"""Relaxation: under constant strain part of the stress decays."""

from __future__ import annotations

# Numba infers the types of kernels; their docstrings describe the arguments.
# mypy: disallow-untyped-defs=False
from copy import copy

import numpy as np

from plop.parameters import Parameter
from plop.physics.effects.body import Body
from plop.physics.effects.effect import Effect
from plop.physics.effects.strain import add_deviator, left_cauchy_green
from plop.physics.engine.jit import kernel

_ONE = np.float32(1)


@kernel()
def relax(c, branch, dt, keep):
    """Convect the branch's strain B - I with the motion and let it decay.

    Takes:
        c: Velocity gradient [N, 3, 3] [1/s].
        branch: Updated: B - I (xx, yy, zz, xy, xz, yz) [N, 6].
        dt, keep: Step [s] and remaining share of B - I after it [-].
    """
    a, g = np.empty((3, 3), np.float32), np.empty((3, 3), np.float32)
    for p in range(c.shape[0]):
        for i in range(3):
            for j in range(3):
                a[i, j] = dt * c[p, i, j]
                same = _ONE if i == j else np.float32(0)
                k = i if i == j else i + j + 2
                g[i, j] = same + branch[p, k]
                a[i, j] += same
        for i in range(3):
            for j in range(i, 3):
                total = -(_ONE if i == j else np.float32(0))
                for m in range(3):
                    for n in range(3):
                        total += a[i, m] * g[m, n] * a[j, n]
                branch[p, i if i == j else i + j + 2] = keep * total


@kernel()
def branch_stress(f, branch, shear_pa, extra):
    """Replace the share of the base's deviatoric stress by that of the branch: shear_pa (dev B - dev b).

    Takes:
        f, branch, shear_pa: Deformation gradient [N, 3, 3], B - I [N, 6], shear modulus of the branch [Pa].
        extra: Added to, [N, 6] [Pa].
    """
    for p in range(f.shape[0]):
        add_deviator(extra, p, -shear_pa, *left_cauchy_green(f, p))
        add_deviator(
            extra, p, shear_pa, branch[p, 0], branch[p, 1], branch[p, 2], branch[p, 3], branch[p, 4], branch[p, 5]
        )


class Relaxation(Effect):
    """A Maxwell branch has part of the shear modulus: mu under fast strain, (1 - ratio) mu under constant strain.

    The branch's strain B follows the upper-convected law, so it is objective, and dev(B) decays as
    exp(-t / tau) under constant strain. It starts without strain: a state that is deformed at the start is
    already relaxed.
    """

    name = "relaxation"
    help = "under constant strain part of the stress decays"
    law = "tau += ratio mu (dev(B) - dev(F F^T)), B' = L B + B L^T - (B - I) / tau"
    source = "Maxwell 1867; upper-convected form: Larson, Constitutive Equations for Polymer Melts, 1988, ch. 1"
    amplitudes = (
        Parameter("ratio", "-", 0.0, 0.95, step=0.1, typical=0.6, help="share of the shear modulus that relaxes"),
    )
    shapes = (Parameter("tau_s", "s", 0.005, 100.0, step=0.0, default=0.2, help="time constant"),)
    variants = tuple({"tau_s": tau} for tau in (0.02, 0.05, 0.2, 0.8))
    remembers = {"branch": ((6,), 0.0)}
    _fades_at_once = False

    def at_rest(self) -> Relaxation:
        """An object at rest for a long time is relaxed: the branch has no stress, (1 - ratio) mu remains."""
        resting = copy(self)
        resting._fades_at_once = True
        return resting

    def stress(self, body: Body, dt: float) -> None:
        """Exchange part of the base's stress for the branch's."""
        shear_pa = np.float32(self["ratio"] * body.material.shear_pa)
        branch_stress(body.f, body.memory["relaxation.branch"], shear_pa, body.extra)

    def after(self, body: Body, dt: float) -> None:
        """Strain the branch and let it relax."""
        if self._fades_at_once:
            return
        relax(body.c, body.memory["relaxation.branch"], np.float32(dt), np.float32(np.exp(-dt / self["tau_s"])))
