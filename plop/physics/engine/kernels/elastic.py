"""Elastic stress of one particle in closed form, for numba kernels; no singular value decomposition.

Every function takes the deformation gradient F row by row (9 scalars) and the two
Lame parameters [Pa], and gives the Kirchhoff stress tau = P F^T, symmetric, as the
six scalars (xx, yy, zz, xy, xz, yz) [Pa].
"""

# Numba infers the types of kernels; their docstrings say what they take.
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

_ONE = np.float32(1)
_HALF = np.float32(0.5)
_SMALLEST_J = np.float32(0.05)
"""Volume ratios below this are treated as this, so that the logarithm stays finite."""


@njit(fastmath=True, forceinline=True)
def determinant(a, b, c, d, e, f, g, h, i):
    """Determinant of a 3x3 matrix given row by row."""
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


@njit(fastmath=True, forceinline=True)
def _left_cauchy_green(a, b, c, d, e, f, g, h, i):
    return (
        a * a + b * b + c * c,
        d * d + e * e + f * f,
        g * g + h * h + i * i,
        a * d + b * e + c * f,
        a * g + b * h + c * i,
        d * g + e * h + f * i,
    )


@njit(fastmath=True, forceinline=True)
def neo_hookean(a, b, c, d, e, f, g, h, i, mu, lam):
    """Compressible neo-Hookean: tau = mu (b - I) + lambda ln(J) I (Bonet & Wood, Eq. 6.28)."""
    j = max(determinant(a, b, c, d, e, f, g, h, i), _SMALLEST_J)
    xx, yy, zz, xy, xz, yz = _left_cauchy_green(a, b, c, d, e, f, g, h, i)
    pressure = lam * math.log(j) - mu
    return mu * xx + pressure, mu * yy + pressure, mu * zz + pressure, mu * xy, mu * xz, mu * yz


@njit(fastmath=True, forceinline=True)
def stable_neo_hookean(a, b, c, d, e, f, g, h, i, mu, lam):
    """Stable neo-Hookean: tau = mu (1 - 1/(I1 + 1)) b + lambda J (J - alpha) I (Smith et al. 2018, Eq. 18).

    alpha = 1 + 3/4 mu/lambda makes F = I free of stress. The coefficients are not rescaled to Lame's, so
    at small strain the material behaves like mu' = 3/4 mu and lambda' = lambda - 5/8 mu.
    """
    j = determinant(a, b, c, d, e, f, g, h, i)
    xx, yy, zz, xy, xz, yz = _left_cauchy_green(a, b, c, d, e, f, g, h, i)
    shear = mu * (_ONE - _ONE / (xx + yy + zz + _ONE))
    pressure = lam * j * (j - _ONE) - np.float32(0.75) * mu * j
    return shear * xx + pressure, shear * yy + pressure, shear * zz + pressure, shear * xy, shear * xz, shear * yz


@njit(fastmath=True, forceinline=True)
def fixed_corotated(a, b, c, d, e, f, g, h, i, mu, lam):
    """Fixed corotated: tau = 2 mu (F - R) F^T + lambda J (J - 1) I (Stomakhin et al. 2012).

    R comes from Newton's iteration R <- (R + R^-T)/2 (Higham 1986), which doubles the correct digits
    each time; six steps reach float32 precision for stretches from 0.1 to 10.
    """
    j = determinant(a, b, c, d, e, f, g, h, i)
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = a, b, c, d, e, f, g, h, i
    for _ in range(6):
        det = determinant(r0, r1, r2, r3, r4, r5, r6, r7, r8)
        s = _HALF / (det if abs(det) > np.float32(1e-6) else np.float32(1e-6))
        t0, t1, t2 = r4 * r8 - r5 * r7, r5 * r6 - r3 * r8, r3 * r7 - r4 * r6
        t3, t4, t5 = r2 * r7 - r1 * r8, r0 * r8 - r2 * r6, r1 * r6 - r0 * r7
        t6, t7, t8 = r1 * r5 - r2 * r4, r2 * r3 - r0 * r5, r0 * r4 - r1 * r3
        r0, r1, r2 = _HALF * r0 + s * t0, _HALF * r1 + s * t1, _HALF * r2 + s * t2
        r3, r4, r5 = _HALF * r3 + s * t3, _HALF * r4 + s * t4, _HALF * r5 + s * t5
        r6, r7, r8 = _HALF * r6 + s * t6, _HALF * r7 + s * t7, _HALF * r8 + s * t8
    two, pressure = mu + mu, lam * j * (j - _ONE)
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = a - r0, b - r1, c - r2, d - r3, e - r4, f - r5, g - r6, h - r7, i - r8
    return (
        two * (r0 * a + r1 * b + r2 * c) + pressure,
        two * (r3 * d + r4 * e + r5 * f) + pressure,
        two * (r6 * g + r7 * h + r8 * i) + pressure,
        two * (r0 * d + r1 * e + r2 * f),
        two * (r0 * g + r1 * h + r2 * i),
        two * (r3 * g + r4 * h + r5 * i),
    )


@njit(fastmath=True, forceinline=True)
def kirchhoff_stress(law, a, b, c, d, e, f, g, h, i, mu, lam):
    """Choose the law by its number in `ElasticLaw`."""
    if law == 0:
        return neo_hookean(a, b, c, d, e, f, g, h, i, mu, lam)
    if law == 1:
        return fixed_corotated(a, b, c, d, e, f, g, h, i, mu, lam)
    return stable_neo_hookean(a, b, c, d, e, f, g, h, i, mu, lam)
